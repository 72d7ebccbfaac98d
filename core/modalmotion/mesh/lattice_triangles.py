"""Triangles between the nodes of a lattice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CLOSED, Topology


def lattice_faces(topology: Topology, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Triangles that join the nodes of a two-axis lattice: each cell in two.

    Returns
    -------
    (faces, 3) int64
        Poles stay open: the ring of nodes next to a pole bounds a hole half a step wide.
    """
    rows, columns = shape
    index = np.arange(rows * columns).reshape(shape)
    for axis, ends in enumerate(topology.ends):
        if ends == CLOSED and shape[axis] > 2:
            index = np.concatenate([index, np.take(index, [0], axis=axis)], axis=axis)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
