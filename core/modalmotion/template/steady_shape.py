"""A reference with less of its frame's noise: what a template is made from."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.modes.topology import CLOSED_CURVE, Topology

# Times that the difference from the mean shape is averaged over neighbours. More leave no less
# error in amplitudes, and flatten what a frame has of its own (docs/decisions/0039).
_ROUNDS: Final = 2


def steady_shape(
    start: NDArray[np.float64],
    middle: NDArray[np.float64],
    faces: NDArray[np.int64],
    topology: Topology | None,
) -> NDArray[np.float64]:
    """Take out of a reference the roughness that its frame alone has.

    The mean of all frames, and the reference's difference from it as far as it is smooth: over
    what is left of it after averages the same averages are taken once more, so that long waves
    stay as they are (Tukey's twicing).

    Parameters
    ----------
    start, middle : (vertices, 3) float64
        The reference, and the mean of all frames where it lies.
    faces : (faces, 3) int64
    topology : Topology or None
        Of curves, whose vertices are neighbours in order.

    Returns
    -------
    (vertices, 3) float64
        The reference to the last bit where the mean is.
    """
    apart = start - middle
    is_curve = topology is not None and topology.n_axes == 1
    if not apart.any() or not (is_curve or len(faces)):
        return start
    n = len(start)
    if is_curve:
        i = np.arange(n)
        i, j = (i, np.roll(i, -1)) if topology == CLOSED_CURVE else (i[:-1], i[1:])
    else:
        i, j = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    own = np.arange(n)
    rows, columns = np.concatenate([i, j, own]), np.concatenate([j, i, own])
    averages = scipy.sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    # Two triangles at an edge join its ends once.
    counts = np.diff(averages.indptr)
    averages.data = np.repeat(1.0 / counts, counts)

    def smooth(field: NDArray[np.float64]) -> NDArray[np.float64]:
        for _ in range(_ROUNDS):
            field = averages @ field
        return field

    once = smooth(apart)
    return middle + once + smooth(apart - once)
