"""Modal signatures and classes of nonrigid motion, from closed-form lattice modes.

Ten tasks, one line each, after ``import modalmotion as mm``:

=============  ===========================================================
read           ``beat = mm.read("beat.npz")``
signature      ``signature = beat.signature(modes=7)``
plot           ``signature.plot("signature.png")``
classify       ``answer = beat.classify()``
strain         ``strain = beat.strain()``
track          ``track = mm.track("map.nii.gz")``
encode         ``stream = beat.encode(rms=0.3)``
decode         ``again = mm.decode(stream)``
train          ``model = mm.train("cases.csv", "mine")``
view           ``beat.view()`` (in a notebook)
report         ``beat.report("out/")``
save           ``signature.save("beat.h5")``
load           ``signature = mm.load("beat.h5")``
=============  ===========================================================
"""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.classification import Classification as Classification
    from modalmotion.classification import Model as Model
    from modalmotion.classification import TrainingOptions as TrainingOptions
    from modalmotion.classification import classify as classify
    from modalmotion.classification import evaluate as evaluate
    from modalmotion.classification import load_model as load_model
    from modalmotion.classification import train as train
    from modalmotion.classification.manifest import read_cases as read_cases
    from modalmotion.clinical import ClinicalReadouts as ClinicalReadouts
    from modalmotion.clinical import clinical_readouts as clinical_readouts
    from modalmotion.clinical.strain import Strain as Strain
    from modalmotion.clinical.strain import strain as strain
    from modalmotion.codec import Encoded as Encoded
    from modalmotion.codec import decode as decode
    from modalmotion.codec import encode as encode
    from modalmotion.errors import ConnectivityError as ConnectivityError
    from modalmotion.errors import CorruptFileError as CorruptFileError
    from modalmotion.errors import InputError as InputError
    from modalmotion.errors import LimitError as LimitError
    from modalmotion.errors import MalformedFileError as MalformedFileError
    from modalmotion.errors import ModalMotionError as ModalMotionError
    from modalmotion.errors import ModeCountError as ModeCountError
    from modalmotion.errors import NonFiniteError as NonFiniteError
    from modalmotion.errors import NotFoundError as NotFoundError
    from modalmotion.errors import ParameterError as ParameterError
    from modalmotion.errors import ShapeError as ShapeError
    from modalmotion.errors import StoreError as StoreError
    from modalmotion.errors import ToleranceError as ToleranceError
    from modalmotion.errors import TopologyError as TopologyError
    from modalmotion.exports.files import load as load
    from modalmotion.exports.files import plot as plot
    from modalmotion.exports.files import save as save
    from modalmotion.exports.files import to_html as to_html
    from modalmotion.exports.reading import read as read
    from modalmotion.exports.tables import to_dataframe as to_dataframe
    from modalmotion.exports.tables import to_xarray as to_xarray
    from modalmotion.formats import ReadLimits as ReadLimits
    from modalmotion.formats import read_npz as read_npz
    from modalmotion.formats import read_sequence as read_sequence
    from modalmotion.formats import write_npz as write_npz
    from modalmotion.formats.volumes import read_images as read_images
    from modalmotion.mesh import Facts as Facts
    from modalmotion.mesh.sequence import MeshSequence as MeshSequence
    from modalmotion.mesh.sequence import mesh_sequence as mesh_sequence
    from modalmotion.modes import ModeLabel as ModeLabel
    from modalmotion.modes import ModeSet as ModeSet
    from modalmotion.modes import lowest_modes as lowest_modes
    from modalmotion.modes.lattice import Lattice as Lattice
    from modalmotion.modes.lattice import project as project
    from modalmotion.modes.lattice import superpose as superpose
    from modalmotion.modes.topologies import CLOSED_CURVE as CLOSED_CURVE
    from modalmotion.modes.topologies import CUP as CUP
    from modalmotion.modes.topologies import CYLINDER as CYLINDER
    from modalmotion.modes.topologies import OPEN_CURVE as OPEN_CURVE
    from modalmotion.modes.topologies import PLANE as PLANE
    from modalmotion.modes.topologies import SPHERE as SPHERE
    from modalmotion.modes.topologies import TORUS as TORUS
    from modalmotion.modes.topologies import End as End
    from modalmotion.modes.topologies import Topology as Topology
    from modalmotion.reports import Report as Report
    from modalmotion.reports.page import report as report
    from modalmotion.signature import measure_tradeoff as measure_tradeoff
    from modalmotion.signature.making import ModalSignature as ModalSignature
    from modalmotion.signature.making import SignatureParameters as SignatureParameters
    from modalmotion.signature.making import modal_signature as modal_signature
    from modalmotion.signature.reconstruction import reconstruct as reconstruct
    from modalmotion.signature.reconstruction import resample as resample
    from modalmotion.simulate import Acquisition as Acquisition
    from modalmotion.simulate import VentricleParameters as VentricleParameters
    from modalmotion.simulate import simulate_ventricle as simulate_ventricle
    from modalmotion.template import Template as Template
    from modalmotion.template import make_template as make_template
    from modalmotion.tracking import Track as Track
    from modalmotion.tracking import track as track
    from modalmotion.viewer.page import view as view

__all__, __getattr__, __dir__ = public_list(globals())
