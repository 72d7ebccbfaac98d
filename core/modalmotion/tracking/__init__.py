"""Tracking of surfaces through observations without correspondence."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.tracking.observation import Observation as Observation
    from modalmotion.tracking.observation import of_surface as of_surface
    from modalmotion.tracking.recordings import segment as segment
    from modalmotion.tracking.recordings import track as track
    from modalmotion.tracking.result import Track as Track

__all__, __getattr__, __dir__ = public_list(globals())
