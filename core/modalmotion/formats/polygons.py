"""Triangulation of polygons, always the same way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Integers = Sequence[int] | NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles, and what the polygons were that they come from.

    Parameters
    ----------
    faces : (faces, 3) int64
    notes : tuple of str
    """

    faces: NDArray[np.int64]
    notes: tuple[str, ...]


def triangulate(offsets: NDArray[np.int64], corners: NDArray[np.int64]) -> Triangles:
    """Split each polygon into a fan from its first corner; drop those of fewer than three.

    Parameters
    ----------
    offsets : (polygons + 1,) int64
        Where each polygon begins in `corners`, and where the last one ends.
    corners : (corners,) int64

    Returns
    -------
    Triangles
        In the order of the polygons: (c0, c1, c2), (c0, c2, c3), ...
    """
    sizes = np.diff(offsets)
    notes = []
    if (n_fans := int((sizes > 3).sum())) > 0:
        notes.append(
            f"Polygons of more than three corners ({n_fans}) were split into triangles, each as a "
            "fan from its first corner."
        )
    if (n_dropped := int((sizes < 3).sum())) > 0:
        notes.append(f"Polygons of fewer than three corners ({n_dropped}) were left out.")
    if not n_fans and not n_dropped:
        return Triangles(corners.reshape(-1, 3), ())
    counts = np.maximum(sizes - 2, 0)
    first = np.repeat(offsets[:-1], counts)
    # Place of each triangle within its fan: 0, 1, ... for each polygon.
    place = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    faces = np.stack(
        [corners[first], corners[first + place + 1], corners[first + place + 2]], axis=1
    )
    return Triangles(faces, tuple(notes))


def triangulate_sizes(sizes: Integers, corners: Integers) -> Triangles:
    """Split polygons that are known by the number of corners of each, as `triangulate` does."""
    ends = np.cumsum(np.asarray(sizes, dtype=np.int64))
    return triangulate(np.concatenate([[0], ends]), np.asarray(corners, dtype=np.int64))
