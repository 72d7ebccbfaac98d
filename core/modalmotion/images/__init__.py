"""Images in space: volumes, sets of planes, their sequences, and profiles through them."""

from modalmotion.images.volume import ImageSequence, Plane, PlaneSet, Volume

__all__ = ["ImageSequence", "Plane", "PlaneSet", "Volume"]
