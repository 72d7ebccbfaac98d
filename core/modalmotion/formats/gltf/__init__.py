"""Binary glTF: animations of morph targets, in and out."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.formats.gltf.animation import MorphAnimation
from modalmotion.formats.gltf.reading import read_glb
from modalmotion.formats.gltf.writing import write_glb

__all__ = ["MorphAnimation", "read_glb", "write_glb"]

check_arguments(globals())
