"""Landmarks between the frames that they are known in: a path, with a deviation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from modalmotion.tracking.landmarks import Proposed
from modalmotion.tracking.observation import Frame, Observation

# Half-way between two frames, of the distance between their places: a valve does not go evenly.
_HALF_WAY: Final = 0.3


def path_between(
    landmarks: Mapping[str, Any] | None, n_frames: int, *, is_closed: bool
) -> tuple[Frame, ...]:
    """Place landmarks that several frames state in those between, for each frame.

    Parameters
    ----------
    landmarks : mapping of str to (frames, 3) array_like
        Others than such are left alone.
    n_frames : int
    is_closed : bool
        Whether the way goes on from the last frame to the first.

    Notes
    -----
    Straight and even from place to place, d apart; the deviation is 0.6 d sqrt(t (1 - t)) at the
    share t of the way.
    """
    marks: list[list[Observation]] = [[] for _ in range(n_frames)]
    for name, value in (landmarks or {}).items():
        own = value.places if isinstance(value, Proposed) else value
        places = np.asarray(own, dtype=np.float64)
        if places.shape != (n_frames, 3):
            continue
        known = np.flatnonzero(np.isfinite(places).all(axis=1))
        if len(known) < 2:
            continue
        ends = zip(known, np.roll(known, -1), strict=True)
        for start, end in ends:
            if end <= start and not is_closed:
                continue
            gap = (end - start) % n_frames
            far = float(np.linalg.norm(places[end] - places[start]))
            for step in range(1, gap):
                t = step / gap
                sd = 2.0 * _HALF_WAY * far * float(np.sqrt(t * (1.0 - t))) + 1e-3
                place = (1.0 - t) * places[start] + t * places[end]
                marks[(start + step) % n_frames].append(
                    Observation(place[None], sd=sd, places=(name,))
                )
    return tuple(map(tuple, marks))
