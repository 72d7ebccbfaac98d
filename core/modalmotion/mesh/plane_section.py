"""Where a plane cuts a triangle mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Section(NamedTuple):
    """The curve in which a plane cuts a surface, as places on the mesh's edges.

    Parameters
    ----------
    corners : (n, 2) int64
        Vertices of each edge that is cut.
    shares : (n, 2) float64
        Of each of them in the place; they add up to 1.
    lengths : (n,) float64, length unit
        Of the curve that lies next to each place.
    segments : (segments, 2) int64
        Places that a triangle joins.
    """

    corners: NDArray[np.int64]
    shares: NDArray[np.float64]
    lengths: NDArray[np.float64]
    segments: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of a triangle mesh, which many planes may cut.

    Parameters
    ----------
    ends : (edges, 2) int64
    of_faces : (faces, 3) int64
        Edges of each triangle.
    """

    ends: NDArray[np.int64]
    of_faces: NDArray[np.int64]

    @staticmethod
    def of(faces: NDArray[np.int64]) -> Edges:
        """List the edges of triangles."""
        sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        ends, places = np.unique(sides, axis=0, return_inverse=True)
        return Edges(ends, places.reshape(-1, 3))

    def cut(self, positions: NDArray[np.float64], heights: NDArray[np.float64]) -> Section:
        """Cut the mesh where the heights of its vertices change their sign.

        Parameters
        ----------
        positions : (vertices, 3) float64, length unit
        heights : (vertices,) float64, length unit
            Above the plane; zero counts as above.
        """
        above = heights >= 0
        is_cut = above[self.ends[:, 0]] != above[self.ends[:, 1]]
        corners = self.ends[is_cut]
        low, high = heights[corners[:, 0]], heights[corners[:, 1]]
        t = low / (low - high)
        shares = np.stack([1.0 - t, t], axis=1)
        places = (shares[:, :, None] * positions[corners]).sum(axis=1)
        number = np.cumsum(is_cut) - 1
        # A plane cuts two edges of a triangle, or none.
        faces = self.of_faces[is_cut[self.of_faces].sum(axis=1) == 2]
        segments = number[faces[is_cut[faces]].reshape(-1, 2)]
        length = np.linalg.norm(places[segments[:, 0]] - places[segments[:, 1]], axis=1)
        halves = np.repeat(length / 2, 2).astype(np.float64)
        lengths: NDArray[np.float64] = np.zeros(len(corners))
        np.add.at(lengths, segments.ravel(), halves)
        return Section(corners, shares, lengths, segments)
