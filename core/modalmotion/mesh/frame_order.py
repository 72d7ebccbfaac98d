"""Order of frames: sorting by time, dropping repetitions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.mesh.checks import FloatArray
from modalmotion.numerals import counted


def in_time_order(vertices: FloatArray, times: Any) -> tuple[FloatArray, Any, tuple[str, ...]]:
    """Sort frames by their time stamps, and drop repetitions.

    Parameters
    ----------
    vertices : (frames, vertices, 3) float
    times : (frames,) array_like, s
        Returned unchanged unless it is a list of finite numbers, one for each frame: the check of
        sequences reports the error.

    Returns
    -------
    vertices : (n, vertices, 3) float
        The same array where nothing changed.
    times : (n,) float64, s
    notes : tuple of str
        Changes to the frames.

    Raises
    ------
    ShapeError
        If two frames of the same time differ.
    """
    stamps: NDArray[Any] = np.asarray(times)
    is_list = stamps.dtype.kind in "fiu" and stamps.shape == np.shape(vertices)[:1]
    if not is_list or not np.isfinite(stamps).all() or (np.diff(stamps) > 0).all():
        return vertices, times, ()
    order = np.argsort(stamps, kind="stable")
    notes = []
    if (np.diff(stamps) < 0).any():
        first = int(np.flatnonzero(np.diff(stamps) < 0)[0]) + 1
        notes.append(
            f"The frames were out of order (first: frame {first}) and were sorted by time; "
            "frames are counted in the new order."
        )
    sorted_times = stamps[order]
    repeats = np.flatnonzero(np.diff(sorted_times) == 0) + 1
    for at in repeats.tolist():
        one, other = int(order[at - 1]), int(order[at])
        if not np.array_equal(vertices[one], vertices[other]):
            raise ShapeError(
                f"Frames {one} and {other} both have the time {sorted_times[at]} s, but differ.",
                remedy="Say which is right: send one of them, or give them different times.",
                frame=other,
            )
    if len(repeats):
        notes.append(
            f"Repeated at the same time and dropped: {counted(len(repeats), 'frame')} (first: "
            f"frame {int(order[repeats[0]])})."
        )
    distinct = np.delete(order, repeats)
    return vertices[distinct], stamps[distinct].astype(np.float64), tuple(notes)
