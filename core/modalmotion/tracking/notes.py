"""Caveats of a track, for the user."""

from __future__ import annotations

from typing import Final

from modalmotion.tracking.doubts import doubts_on
from modalmotion.tracking.result import Track

# Below this share of the surface under points, what is said of it is said by the prior.
_LOW_COVERAGE: Final = 0.8
_LOW_INLIERS: Final = 0.5

_OFFSETS: Final = (
    "The motion follows the data along the surface's normals; along the surface it is the prior's, "
    "with the standard deviation stated: twist and sliding are not measured."
)


def notes_on(result: Track) -> list[str]:
    """Say what was not seen, and what the prior said instead."""
    notes = [_OFFSETS]
    if result.unseen:
        notes.append(
            f"Nothing was observed in {len(result.unseen)} of {result.n_frames} frames (the first "
            f"is frame {result.unseen[0]}); there the motion is interpolated."
        )
    low = [k for k, c in enumerate(result.coverage) if c < _LOW_COVERAGE and k not in result.unseen]
    if low:
        notes.append(
            f"In {len(low)} frames points lie at less than {_LOW_COVERAGE:.0%} of the surface (at "
            f"least {result.coverage[low].min():.0%}, frame {low[0]}); elsewhere the prior speaks."
        )
    strays = [k for k, c in enumerate(result.inliers) if 0 < c < _LOW_INLIERS]
    if strays:
        notes.append(
            f"In {len(strays)} frames, frame {strays[0]} the first, most points lie off the "
            "surface: they may show another object."
        )
    undetermined = int((result.determined[:, 1] < 0.5).sum())
    if undetermined:
        notes.append(
            f"Of {len(result.modes)} modes the data leave the tangential part of {undetermined} "
            "undetermined."
        )
    notes += doubts_on(result)
    return notes
