"""Sides of the triangles of a large mesh, each edge once, by compiled kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.connectivity import Connectivity, grouped_edges
from modalmotion.mesh.machine import Kernels, kernels_for

Floats = NDArray[np.float64]
Indices = NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class Sides:
    """Edges by their smaller vertex, and the edge of each side of each triangle.

    Parameters
    ----------
    faces : (3 * faces,) uint32
        Corners of one triangle after another.
    first : (vertices + 1,) uint32
        Where the edges of each vertex begin.
    end : (edges,) uint32
        Their larger vertices, in increasing order at each.
    count : (edges,) uint8
        Triangles at each: 1 or 2.
    ahead : (edges,) uint8
        Of these, how many run along it from the smaller vertex to the larger.
    edge : (3 * faces,) uint32
        From each corner to the next.
    kernels : Kernels
    """

    faces: Indices
    first: Indices
    end: Indices
    count: NDArray[np.uint8]
    ahead: NDArray[np.uint8]
    edge: Indices
    kernels: Kernels

    @property
    def n_vertices(self) -> int:
        """Number of vertices, with those in no triangle."""
        return len(self.first) - 1

    @property
    def is_wound(self) -> bool:
        """Whether neighbours run along their common edges in opposite directions."""
        return not (self.ahead.any() and ((self.ahead > 1) | (self.count - self.ahead > 1)).any())

    def connectivity(self) -> Connectivity:
        """Give what `connectivity_of` gives."""
        n = self.n_vertices
        starts = np.repeat(np.arange(n), np.diff(self.first))
        edges = np.empty((len(self.end), 2), dtype=np.int64)
        edges[:, 0], edges[:, 1] = starts, self.end
        n_faces_at = np.bincount(self.faces, minlength=n)
        n_edges_at = np.bincount(self.end, minlength=n) + np.diff(self.first)
        name = np.arange(n, dtype=np.uint32)
        n_pieces = self.kernels.run("name_pieces", n, self.first, self.end, name)
        isolated = np.flatnonzero(n_faces_at == 0)
        none = np.zeros(0, dtype=np.int64)
        return Connectivity(
            edges=edges,
            faces_at_edge=self.count.astype(np.int64),
            loops=tuple(grouped_edges(edges[self.count == 1], n)),
            isolated=isolated,
            n_components=n_pieces - len(isolated),
            euler_characteristic=n - len(isolated) - len(edges) + len(self.faces) // 3,
            degenerate=none,
            repeated=none,
            pinched=np.flatnonzero(n_edges_at - n_faces_at > 1),
        )

    def stiffness(self, vertices: Floats) -> tuple[Floats, Floats]:
        """Entry of the stiffness at each edge, and the area at each vertex.

        See `cotangent_laplacian` and `vertex_areas`.

        Parameters
        ----------
        vertices : (vertices, 3) float64

        Returns
        -------
        weights : (edges,) float64
        areas : (vertices,) float64
        """
        weights, areas = np.zeros(len(self.end)), np.zeros(len(vertices))
        places = np.ascontiguousarray(vertices)
        n = len(self.faces) // 3
        self.kernels.run("weigh_edges", n, places, self.faces, self.edge, weights, areas)
        return weights, areas

    def mean_gradient(self, vertices: Floats, values: Floats, *, closed: bool) -> float:
        """Mean over the area of the length of the gradient of a function.

        Parameters
        ----------
        vertices : (vertices, 3) float64, length unit
        values : (vertices,) float64
            Linear on triangles; in turns where `closed`.
        """
        sums = np.zeros(2)
        places, values = np.ascontiguousarray(vertices), np.ascontiguousarray(values)
        n = len(self.faces) // 3
        self.kernels.run("add_gradients", n, places, self.faces, values, int(closed), sums)
        return float(sums[0] / sums[1]) if sums[1] > 0 else 0.0

    def vector_area(self, vertices: Floats) -> Floats:
        """Twice the vector area, (3,): the sum of `face_normals`, of triangles wound alike.

        Parameters
        ----------
        vertices : (vertices, 3) float64
        """
        sums, places = np.zeros(3), np.ascontiguousarray(vertices)
        self.kernels.run("add_normals", len(self.faces) // 3, places, self.faces, sums)
        return sums

    def covered(self, s: Floats, t: Floats, *, closed: tuple[bool, bool]) -> float:
        """Signed area of the triangles in the plane of two coordinates.

        Parameters
        ----------
        s, t : (vertices,) float64
        closed : tuple of bool
            Which of them are turns.
        """
        sums = np.zeros(1)
        s, t = np.ascontiguousarray(s), np.ascontiguousarray(t)
        n = len(self.faces) // 3
        self.kernels.run("add_covered", n, self.faces, s, t, *map(int, closed), sums)
        return float(sums[0])


def sides_of(faces: NDArray[np.int64], n_vertices: int) -> Sides | None:
    """Find the sides of a large mesh of proper triangles.

    Parameters
    ----------
    faces : (faces, 3) int64
    n_vertices : int

    Returns
    -------
    Sides, or None
        None where there are no kernels, where a triangle names a vertex twice, or where more
        than two share an edge: `connectivity_of` then says more.
    """
    kernels = kernels_for(n_vertices)
    if kernels is None or not 0 < len(faces) < 2**28:
        return None
    corners = faces.astype(np.uint32).ravel()
    a, b, c = corners.reshape(-1, 3).T
    if ((a == b) | (b == c) | (c == a)).any():
        return None
    n = len(corners)
    first = np.zeros(n_vertices + 1, dtype=np.uint32)
    end, edge = np.empty(n, dtype=np.uint32), np.empty(n, dtype=np.uint32)
    count, ahead = np.empty(n, dtype=np.uint8), np.empty(n, dtype=np.uint8)
    keys = np.empty(n, dtype=np.int64)
    n_edges = kernels.run(
        "join_sides", n_vertices, n // 3, corners, first, keys, end, count, ahead, edge
    )
    del keys
    count = count[:n_edges].copy()
    if (count > 2).any():
        return None
    return Sides(corners, first, end[:n_edges].copy(), count, ahead[:n_edges].copy(), edge, kernels)
