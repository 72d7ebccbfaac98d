"""Images in space: volumes, sets of planes and their sequences."""

from modalmotion.images.volume import ImageSequence, Plane, PlaneSet, Volume

__all__ = ["ImageSequence", "Plane", "PlaneSet", "Volume"]
