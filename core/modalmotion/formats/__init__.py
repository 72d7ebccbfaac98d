"""File formats of mesh sequences."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.formats.detect import Format, detect_format
from modalmotion.formats.frames.archive import write_ply_zip
from modalmotion.formats.gltf import MorphAnimation, write_glb
from modalmotion.formats.npz import read_npz, write_npz
from modalmotion.formats.options import ReadOptions
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.formats.parser.registry import ParserHere
from modalmotion.formats.raw import write_raw
from modalmotion.formats.reading import read_sequence
from modalmotion.formats.result import Reading
from modalmotion.formats.vtk.vtkhdf_writing import write_vtkhdf
from modalmotion.limits import DEFAULT_LIMITS, NO_LIMITS, ReadLimits
from modalmotion.progress import Progress

__all__ = [
    "DEFAULT_LIMITS",
    "NO_LIMITS",
    "Format",
    "MorphAnimation",
    "Parser",
    "ParserHere",
    "ParserProcess",
    "Progress",
    "ReadLimits",
    "ReadOptions",
    "Reading",
    "detect_format",
    "read_npz",
    "read_sequence",
    "write_glb",
    "write_npz",
    "write_ply_zip",
    "write_raw",
    "write_vtkhdf",
]

check_arguments(globals())
