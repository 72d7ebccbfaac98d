"""Modal signatures and classes of nonrigid motion, from closed-form lattice modes."""

from importlib import import_module
from typing import TYPE_CHECKING

from modalmotion.errors import (
    ConnectivityError,
    CorruptFileError,
    InputError,
    LimitError,
    MalformedFileError,
    ModalMotionError,
    ModeCountError,
    NonFiniteError,
    NotFoundError,
    ParameterError,
    ShapeError,
    StoreError,
    ToleranceError,
    TopologyError,
)

if TYPE_CHECKING:
    from modalmotion.clinical import ClinicalReadouts, clinical_readouts
    from modalmotion.facts import Facts
    from modalmotion.formats import ReadLimits, read_npz, write_npz
    from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
    from modalmotion.modes import ModeLabel, ModeSet, lowest_modes, whole_count
    from modalmotion.modes.lattice import Lattice
    from modalmotion.modes.topology import (
        CLOSED_CURVE,
        CUP,
        CYLINDER,
        OPEN_CURVE,
        PLANE,
        SPHERE,
        TORUS,
        End,
        Topology,
    )
    from modalmotion.modes.transform import project, project_all, superpose, superpose_all
    from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
    from modalmotion.signature.reconstruction import reconstruct
    from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
    from modalmotion.template import Template, Weights, make_template

__all__ = [
    "CLOSED_CURVE",
    "CUP",
    "CYLINDER",
    "OPEN_CURVE",
    "PLANE",
    "SPHERE",
    "TORUS",
    "Acquisition",
    "ClinicalReadouts",
    "ConnectivityError",
    "CorruptFileError",
    "End",
    "Facts",
    "InputError",
    "Lattice",
    "LimitError",
    "MalformedFileError",
    "MeshSequence",
    "ModalMotionError",
    "ModalSignature",
    "ModeCountError",
    "ModeLabel",
    "ModeSet",
    "NonFiniteError",
    "NotFoundError",
    "ParameterError",
    "ReadLimits",
    "ShapeError",
    "SignatureParameters",
    "StoreError",
    "Template",
    "ToleranceError",
    "Topology",
    "TopologyError",
    "VentricleParameters",
    "Weights",
    "clinical_readouts",
    "lowest_modes",
    "make_template",
    "mesh_sequence",
    "modal_signature",
    "project",
    "project_all",
    "read_npz",
    "reconstruct",
    "simulate_ventricle",
    "superpose",
    "superpose_all",
    "whole_count",
    "write_npz",
]

# Imported when they are first asked for: all at once take most of a second, and much of what
# needs this package (a client, the help of a command) needs few of them.
_HOMES = {
    "modalmotion.clinical": (
        "ClinicalReadouts",
        "clinical_readouts",
    ),
    "modalmotion.facts": ("Facts",),
    "modalmotion.formats": (
        "ReadLimits",
        "read_npz",
        "write_npz",
    ),
    "modalmotion.modes.lattice": ("Lattice",),
    "modalmotion.modes": (
        "ModeLabel",
        "ModeSet",
        "lowest_modes",
        "whole_count",
    ),
    "modalmotion.signature.reconstruction": ("reconstruct",),
    "modalmotion.mesh.sequence": (
        "MeshSequence",
        "mesh_sequence",
    ),
    "modalmotion.signature.making": (
        "ModalSignature",
        "SignatureParameters",
        "modal_signature",
    ),
    "modalmotion.simulate": (
        "Acquisition",
        "VentricleParameters",
        "simulate_ventricle",
    ),
    "modalmotion.template": (
        "Template",
        "Weights",
        "make_template",
    ),
    "modalmotion.modes.topology": (
        "CLOSED_CURVE",
        "CUP",
        "CYLINDER",
        "OPEN_CURVE",
        "PLANE",
        "SPHERE",
        "TORUS",
        "End",
        "Topology",
    ),
    "modalmotion.modes.transform": (
        "project",
        "project_all",
        "superpose",
        "superpose_all",
    ),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import a public name (PEP 562)."""
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
