"""What to check in the reference frame of images: landmarks, and neighbours that look alike."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.images.sequence import Image
from modalmotion.tracking.image_view import Facets, Sight, view_of

Floats = NDArray[np.float64]

# Of the mean radius: how far the middle may be beside the axis.
_ASIDE: Final = 0.35

# Radius near the apex over that near the base: more where the two are taken for one another.
_SWAPPED: Final = 1.05

# mm beyond the surface that neighbours are looked for in, and that one is wide at least; how much
# like the inside it is; and the least share of profiles with one.
_BEYOND: Final = (4.0, 20.0)
_WIDE: Final = 5.0
_ALIKE: Final = 0.4
_SHARE: Final = 0.03


def image_notes(
    image: Image, facets: Facets, x: Floats, sight: Sight, apex: Floats, base: Floats
) -> tuple[str, ...]:
    """Say what speaks against the landmarks, and whether others look like the object.

    Parameters
    ----------
    image : Volume or PlaneSet
    facets : Facets
    x : (vertices, 3) float64, mm
        Surface of the reference frame.
    sight : Sight
    apex, base : (3,) float64, mm
        As they are stated.
    """
    notes = []
    axis = (base - apex) / np.linalg.norm(base - apex)
    heights = (x - apex) @ axis / np.linalg.norm(base - apex)
    across = x - apex - np.outer((x - apex) @ axis, axis)
    middle = across[(heights > 0.1) & (heights < 0.9)]
    if not len(middle):
        return ("Hardly any of the surface is between apex and base: check both.",)
    radius = float(np.linalg.norm(middle - middle.mean(axis=0), axis=1).mean())
    aside = float(np.linalg.norm(middle.mean(axis=0)))
    if aside > _ASIDE * radius:
        notes.append(
            f"The axis from apex to base runs {aside:.0f} mm beside the middle of what was found, "
            f"which has a radius of {radius:.0f} mm: check both landmarks."
        )
    low, high = (_radius(across, np.abs(heights - h) < 0.1) for h in (0.2, 0.8))
    if low > _SWAPPED * high:
        notes.append(
            f"What was found is wider near the apex ({low:.0f} mm) than near the base "
            f"({high:.0f} mm): are the two swapped?"
        )
    share = _alike_beyond(image, facets, x, sight)
    if share > _SHARE:
        notes.append(
            f"Beyond {share:.0%} of the surface something else looks like its inside; the object "
            "between the landmarks is followed."
        )
    return tuple(notes)


def _radius(across: Floats, there: NDArray[np.bool_]) -> float:
    if there.sum() < 3:
        return 0.0
    own = across[there]
    return float(np.linalg.norm(own - own.mean(axis=0), axis=1).mean())


def _alike_beyond(image: Image, facets: Facets, x: Floats, sight: Sight) -> float:
    """Share of the profiles on which something like the inside comes again beyond the edge."""
    near, far = _BEYOND
    view = view_of(image, facets, x, sight, far)
    like = sight.levels.likeness(view.profiles, sight.gain(view.starts)[:, None])
    there = view.edges.is_found & (np.abs(view.edges.offsets) < near)
    if not there.any():
        return 0.0
    step = float(view.offsets[1] - view.offsets[0])
    n = max(1, round(_WIDE / step))
    beyond = np.clip(like[there][:, (view.offsets > near) & (view.offsets < far)], -1.0, 1.0)
    sums = np.concatenate([np.zeros((len(beyond), 1)), beyond.cumsum(axis=1)], axis=1)
    means = (sums[:, n:] - sums[:, :-n]) / n
    return float((means.max(axis=1, initial=-1.0) > _ALIKE).mean())
