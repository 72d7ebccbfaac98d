"""Connectivity of a mesh: edges, boundary loops, pieces, handles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.representation import shown


@shown()
@dataclass(frozen=True, eq=False)
class Connectivity:
    """Counts and loops from the faces alone.

    Parameters
    ----------
    edges : (edges, 2) int64
        Each once, the smaller vertex first, in increasing order.
    faces_at_edge : (edges,) int64
        Triangles that share it: 1 on a boundary, 2 inside, more where the mesh is not a surface.
    loops : tuple of (edges, 2) int64
        Boundary edges, grouped by connection.
    isolated : (n,) int64
        Vertices in no triangle.
    n_components : int
        Pieces that hold at least one triangle.
    euler_characteristic : int
        Vertices - edges + triangles, over the vertices that triangles use.
    degenerate : (n,) int64
        Triangles that name a vertex twice; they join nothing and are left out of all counts.
    repeated : (n,) int64
        Triangles of the same three vertices as an earlier one, in any winding, found where three
        or more share an edge; they are left out of all counts too.
    pinched : (n,) int64
        Boundary vertices in which two strips of triangles meet in a point.
    """

    edges: NDArray[np.int64]
    faces_at_edge: NDArray[np.int64]
    loops: tuple[NDArray[np.int64], ...]
    isolated: NDArray[np.int64]
    n_components: int
    euler_characteristic: int
    degenerate: NDArray[np.int64]
    repeated: NDArray[np.int64]
    pinched: NDArray[np.int64]

    @property
    def left_out(self) -> NDArray[np.int64]:
        """Triangles that do not count, (n,) int64."""
        return np.union1d(self.degenerate, self.repeated)

    @property
    def non_manifold_edges(self) -> NDArray[np.int64]:
        """Edges of three triangles or more, (n, 2) int64."""
        return self.edges[self.faces_at_edge > 2]

    @property
    def genus(self) -> float:
        """Handles of a single piece; a half where the surface has one side only."""
        return 1.0 - (self.euler_characteristic + len(self.loops)) / 2

    def describe(self) -> str:
        """Summary in one line, for errors and notes."""
        parts = [
            f"{self.n_components} piece(s)",
            f"{len(self.loops)} boundary loop(s)",
            f"Euler characteristic {self.euler_characteristic}",
        ]
        if len(self.non_manifold_edges):
            parts.append(f"{len(self.non_manifold_edges)} edges of more than two triangles")
        if len(self.pinched):
            parts.append(f"{len(self.pinched)} vertices in which boundaries touch")
        return ", ".join(parts)

    def details(self) -> dict[str, object]:
        """Return the counts, ready for JSON."""
        return {
            "components": self.n_components,
            "boundary_loops": len(self.loops),
            "euler_characteristic": self.euler_characteristic,
            "non_manifold_edges": len(self.non_manifold_edges),
            "pinched_vertices": len(self.pinched),
            "isolated_vertices": len(self.isolated),
        }


def connectivity_of(faces: NDArray[np.int64], n_vertices: int) -> Connectivity:
    """Find edges, loops, pieces and handles.

    Parameters
    ----------
    faces : (faces, 3) int64
    n_vertices : int

    Returns
    -------
    Connectivity
    """
    a, b, c = faces.T
    twice = (a == b) | (b == c) | (c == a)
    proper = faces[~twice]
    keys, counts = _sides(proper, n_vertices)
    repeated = np.zeros(0, dtype=np.int64)
    if (counts > 2).any():
        repeated = np.flatnonzero(~twice)[_repeated(proper)]
        if len(repeated):
            proper = np.delete(faces, np.union1d(np.flatnonzero(twice), repeated), axis=0)
            keys, counts = _sides(proper, n_vertices)
    edges = np.stack([keys // n_vertices, keys % n_vertices], axis=1)
    n_faces_at = np.bincount(proper.ravel(), minlength=n_vertices)
    n_edges_at = np.bincount(edges.ravel(), minlength=n_vertices)
    labels = _labels(edges, n_vertices)
    used = n_faces_at > 0
    n_pieces = len(np.unique(labels[used]))
    return Connectivity(
        edges=edges,
        faces_at_edge=counts,
        loops=tuple(grouped_edges(edges[counts == 1], n_vertices)),
        isolated=np.flatnonzero(~used),
        n_components=n_pieces,
        euler_characteristic=int(used.sum()) - len(edges) + len(proper),
        degenerate=np.flatnonzero(twice),
        repeated=repeated,
        pinched=np.flatnonzero(n_edges_at - n_faces_at > 1),
    )


def _sides(
    faces: NDArray[np.int64], n_vertices: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges, each as one integer, in increasing order, and the triangles at each."""
    # One integer a side: sorting integers makes this linear in practice.
    start, end = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    return np.unique(
        np.minimum(start, end) * np.int64(n_vertices) + np.maximum(start, end), return_counts=True
    )


def _repeated(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles whose three vertices are those of an earlier one."""
    a, b, c = np.sort(faces, axis=1).T
    order = np.lexsort((c, b, a))
    rows = np.stack([a, b, c], axis=1)[order]
    return np.sort(order[1:][(rows[1:] == rows[:-1]).all(axis=1)])


def grouped_edges(edges: NDArray[np.int64], n_vertices: int) -> list[NDArray[np.int64]]:
    """Group edges by connection, largest number of edges first.

    Parameters
    ----------
    edges : (edges, 2) int64
    n_vertices : int

    Returns
    -------
    list of (edges, 2) int64
        Rows as they came, in the same order within each group.
    """
    if not len(edges):
        return []
    place = np.full(n_vertices, -1)
    place[edges.ravel()] = 0
    nodes = np.flatnonzero(place == 0)
    place[nodes] = np.arange(len(nodes))
    component = _labels(place[edges], len(nodes))[place[edges[:, 0]]]
    groups = [edges[component == i] for i in np.unique(component)]
    return sorted(groups, key=lambda group: (-len(group), int(group.min())))


def oriented_faces(faces: NDArray[np.int64], n_vertices: int) -> NDArray[np.int64] | None:
    """Wind all triangles the same way round, as the first one of each piece.

    Returns
    -------
    (faces, 3) int64, or None
        None where that is impossible: a surface with one side only.
    """
    n, m = np.int64(n_vertices), len(faces)
    start, end = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    directed = np.sort(start * n + end)
    if (directed[1:] != directed[:-1]).all():
        # No side is run along twice the same way: they agree already.
        return faces
    key = np.minimum(start, end) * n + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    key = key[order]
    same = np.flatnonzero(key[1:] == key[:-1])
    i, j = order[same], order[same + 1]
    one, other = i // 3, j // 3
    # Each triangle twice, as it is and turned over: neighbours that run along their common
    # side in opposite directions agree. A piece with two sides falls into two copies.
    agree = start[i] != start[j]
    rows = np.concatenate([one, one + m])
    columns = np.concatenate([np.where(agree, other, other + m), np.where(agree, other + m, other)])
    graph = scipy.sparse.coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * m, 2 * m))
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    as_is, turned = label[:m], label[m:]
    if (as_is == turned).any():
        return None
    first = np.full(int(label.max(initial=0)) + 1, 2 * m)
    np.minimum.at(first, label, np.arange(2 * m))
    # Of a piece's two copies the one with its first triangle unturned is kept.
    turn = first[as_is] >= m
    turn |= first[turned] < first[as_is]
    return np.where(turn[:, None], faces[:, ::-1], faces)


def _labels(edges: NDArray[np.int64], n_vertices: int) -> NDArray[np.int64]:
    graph = scipy.sparse.coo_array(
        (np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])),
        shape=(n_vertices, n_vertices),
    )
    _, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    numbers: NDArray[np.int64] = labels.astype(np.int64)
    return numbers
