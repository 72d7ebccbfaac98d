"""Tracking of surfaces through observations without correspondence."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.tracking.making import segment, track
from modalmotion.tracking.observation import Observation, of_surface
from modalmotion.tracking.result import Track

__all__ = ["Observation", "Track", "of_surface", "segment", "track"]

check_arguments(globals())
