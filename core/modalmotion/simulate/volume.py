"""Volume that a surface with openings encloses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Cavity:
    """What the triangles of a surface enclose, its openings closed by fans.

    Parameters
    ----------
    faces : (faces, 3) int64
        Consistently wound; outward for a positive volume. No two openings share a vertex.
    """

    faces: NDArray[np.int64]

    def volume(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Volume enclosed by vertices in these positions.

        Parameters
        ----------
        vertices : (..., vertices, 3) float64, length unit

        Returns
        -------
        (...) float64, length unit cubed

        Notes
        -----
        Divergence theorem: V = 1/6 sum a . (b x c) over the triangles of the closed surface.
        Each opening is closed by triangles from its edges to the mean of its vertices.
        """
        # About a point nearby, so that a distant origin costs no digits.
        vertices = vertices - vertices[..., :1, :]
        six_fold = _triple(*(vertices[..., self.faces[:, i], :] for i in range(3)))
        for loop in self.loops:
            rim = vertices[..., loop, :]
            centre = rim.mean(axis=-2, keepdims=True)
            # An edge a -> b of a face is b -> a in the lid.
            six_fold += _triple(centre, np.roll(rim, -1, axis=-2), rim)
        volume: NDArray[np.float64] = six_fold / 6.0
        return volume

    @cached_property
    def loops(self) -> list[NDArray[np.int64]]:
        """Vertices around each opening, in the sense of the faces' edges."""
        edges = np.concatenate(
            [self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]
        )
        _, inverse, counts = np.unique(
            np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        following = dict(edges[counts[inverse.ravel()] == 1].tolist())
        loops = []
        while following:
            start, vertex = following.popitem()
            loop = [start]
            while vertex != start:
                loop.append(vertex)
                vertex = following.pop(vertex)
            loops.append(np.array(loop, dtype=np.int64))
        return loops


def _triple(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Sum of a . (b x c)."""
    total: NDArray[np.float64] = (
        a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1])
        + a[..., 1] * (b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2])
        + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
    ).sum(axis=-1)
    return total
