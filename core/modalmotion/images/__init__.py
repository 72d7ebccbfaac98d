"""Images in space: volumes, sets of planes, their sequences, and profiles through them."""

from modalmotion.images.sequence import ImageSequence
from modalmotion.images.volume import Plane, PlaneSet, Volume

__all__ = ["ImageSequence", "Plane", "PlaneSet", "Volume"]
