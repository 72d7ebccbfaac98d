"""Modal signatures and classes of nonrigid motion, from closed-form lattice modes."""

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
from modalmotion.formats import ReadLimits, read_npz, write_npz
from modalmotion.lattice import Lattice
from modalmotion.modes import ModeLabel, ModeSet, lowest_modes, whole_count
from modalmotion.reconstruction import reconstruct
from modalmotion.sequence import MeshSequence, mesh_sequence
from modalmotion.signature import ModalSignature, SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.template import Template, Weights, make_template
from modalmotion.topology import (
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
from modalmotion.transform import project, project_all, superpose, superpose_all

__all__ = [
    "CLOSED_CURVE",
    "CUP",
    "CYLINDER",
    "OPEN_CURVE",
    "PLANE",
    "SPHERE",
    "TORUS",
    "Acquisition",
    "ConnectivityError",
    "CorruptFileError",
    "End",
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
