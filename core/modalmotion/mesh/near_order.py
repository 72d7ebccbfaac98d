"""A large mesh numbered along a curve in space, so that neighbours are near in memory."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.machine import Kernels, is_large, kernels_for
from modalmotion.mesh.space_order import space_codes

# Of each axis: finer steps would change the order within a few vertices only.
_BITS: Final = 11
_DIGITS: Final = 3 * 2048


def near_order(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Order the vertices along a Morton curve, and the triangles by their first vertex on it.

    Parameters
    ----------
    vertices : (vertices, 3) float64
    faces : (faces, 3) int64

    Returns
    -------
    order : (vertices,) int64
        Vertices in their order.
    faces : (faces, 3) int64
        In theirs, by the new numbers.

        None instead of both where the mesh is small.
    """
    n = len(vertices)
    if not is_large(n) or not 0 < len(faces) < 2**28:
        return None
    kernels = kernels_for(n)
    order = _sorted(kernels, space_codes(vertices, _BITS).view(np.int64))
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n)
    corners = np.take(place, faces)
    a, b, c = corners.T
    by_first = _sorted(kernels, np.minimum(np.minimum(a, b), c))
    return order, np.take(corners, by_first, axis=0)


def _sorted(kernels: Kernels | None, codes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Order codes of 33 bits, equals as they came; the codes are overwritten."""
    if kernels is None:
        return np.argsort(codes, kind="stable")
    n = len(codes)
    order, other = np.arange(n, dtype=np.uint32), np.empty(n, dtype=np.uint32)
    counts = np.zeros(_DIGITS, dtype=np.int64)
    kernels.run("sort_codes", n, codes, order, np.empty_like(codes), other, counts)
    return other.astype(np.int64)
