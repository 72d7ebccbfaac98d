"""Images in space: volumes, sets of planes, their sequences, and profiles through them."""

from modalmotion.images.plane_set import Plane, PlaneSet
from modalmotion.images.sequence import ImageSequence
from modalmotion.images.volume import Volume

__all__ = ["ImageSequence", "Plane", "PlaneSet", "Volume"]
