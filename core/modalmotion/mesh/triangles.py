"""Connectivity, areas, normals and gradients of triangle meshes and curves; merged vertices.

Areas, normals and gradients need vertices whose squares neither overflow nor vanish:
`make_template` scales them first.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from modalmotion.modes.topologies import CLOSED_CURVE, OPEN_CURVE, Topology
from modalmotion.representation import FloatArray, Floats, Ints, shown


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
        Pieces that contain at least one triangle.
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

    edges: Ints
    faces_at_edge: Ints
    loops: tuple[Ints, ...]
    isolated: Ints
    n_components: int
    euler_characteristic: int
    degenerate: Ints
    repeated: Ints
    pinched: Ints

    @property
    def left_out(self) -> Ints:
        """Triangles that do not count, (n,) int64."""
        return np.union1d(self.degenerate, self.repeated)

    @property
    def non_manifold_edges(self) -> Ints:
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


def connectivity_of(faces: Ints, n_vertices: int) -> Connectivity:
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
    labels = pieces_of(edges, n_vertices)
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


def _sides(faces: Ints, n_vertices: int) -> tuple[Ints, Ints]:
    """Edges, each as one integer, in increasing order, and the triangles at each."""
    # One integer a side: sorting integers makes this linear in practice.
    start, end = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    return np.unique(
        np.minimum(start, end) * np.int64(n_vertices) + np.maximum(start, end), return_counts=True
    )


def _repeated(faces: Ints) -> Ints:
    """Triangles whose three vertices are those of an earlier one."""
    a, b, c = np.sort(faces, axis=1).T
    order = np.lexsort((c, b, a))
    rows = np.stack([a, b, c], axis=1)[order]
    return np.sort(order[1:][(rows[1:] == rows[:-1]).all(axis=1)])


def grouped_edges(edges: Ints, n_vertices: int) -> list[Ints]:
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
    component = pieces_of(place[edges], len(nodes))[place[edges[:, 0]]]
    groups = [edges[component == i] for i in np.unique(component)]
    return sorted(groups, key=lambda group: (-len(group), int(group.min())))


def oriented_faces(faces: Ints, n_vertices: int) -> Ints | None:
    """Wind all triangles the same way round, as the first one of each piece.

    Returns
    -------
    (faces, 3) int64, or None
        None if that is impossible: a surface with one side only.
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
    label = pieces_of(np.stack([rows, columns], axis=1), 2 * m)
    as_is, turned = label[:m], label[m:]
    if (as_is == turned).any():
        return None
    first = np.full(int(label.max(initial=0)) + 1, 2 * m)
    np.minimum.at(first, label, np.arange(2 * m))
    # Of a piece's two copies the one with its first triangle unturned is kept.
    turn = first[as_is] >= m
    turn |= first[turned] < first[as_is]
    return np.where(turn[:, None], faces[:, ::-1], faces)


def pieces_of(edges: Ints, n_vertices: int) -> Ints:
    """Give each vertex the number of the piece that edges, (n, 2), join: (vertices,) int64."""
    graph = scipy.sparse.coo_array(
        (np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])),
        shape=(n_vertices, n_vertices),
    )
    _, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return np.asarray(labels.astype(np.int64))


def face_normals(vertices: Floats, faces: Ints) -> Floats:
    """Cross product of two sides of each triangle.

    Returns
    -------
    (faces, 3) float64, length unit squared
        Twice the area long, right-handed about the order of the corners.
    """
    a, b, c = corners_of(vertices, faces)
    b -= a
    c -= a
    normals = np.empty((len(faces), 3))
    normals[:, 0] = b[:, 1] * c[:, 2] - b[:, 2] * c[:, 1]
    normals[:, 1] = b[:, 2] * c[:, 0] - b[:, 0] * c[:, 2]
    normals[:, 2] = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    return normals


def corners_of(vertices: Floats, faces: Ints) -> tuple[Floats, Floats, Floats]:
    """Places of the first, second and third corners, each (faces, 3) and a copy."""
    # `take` reads a vertex at once; indexing, or axis by axis, takes three times as long where
    # neighbours are far apart in memory.
    first, second, third = (np.take(vertices, faces[:, i], axis=0) for i in range(3))
    return first, second, third


def face_areas(vertices: Floats, faces: Ints) -> Floats:
    """Area of each triangle, (faces,) float64, length unit squared."""
    normals = face_normals(vertices, faces)
    return np.asarray(0.5 * np.sqrt(np.einsum("ij,ij->i", normals, normals)))


def vertex_areas(vertices: Floats, faces: Ints) -> Floats:
    """Third of the area of the triangles around each vertex.

    Returns
    -------
    (vertices,) float64, length unit squared
        Zero at vertices in no triangle.
    """
    thirds = np.repeat(face_areas(vertices, faces) / 3.0, 3)
    return np.asarray(
        np.bincount(faces.ravel(), weights=thirds, minlength=len(vertices)).astype(np.float64)
    )


def mean_slopes(vertices: Floats, faces: Ints, values: Floats, gradients: Floats) -> Floats:
    """Differentiate means of functions over the area by the positions.

    F = sum A m / sum A with areas A and means m over corners: dF = sum ((m - F) dA + A dm) / sum A.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
    faces : (faces, 3) int64
    values : (functions, vertices) float64
    gradients : (functions, vertices or 1, 3) float64, value per length unit

    Returns
    -------
    (functions, vertices, 3) float64, value per length unit
    """
    n = face_normals(vertices, faces)
    size = np.linalg.norm(n, axis=1)
    areas, unit = size / 2.0, n / np.where(size > 0, size, 1.0)[:, None]
    total = float(areas.sum()) or 1.0
    means = values[:, faces].mean(axis=2)
    means -= (means @ areas / total)[:, None]
    shares = np.bincount(faces.ravel(), np.repeat(areas / (3.0 * total), 3), len(vertices))
    slopes: Floats = gradients * shares[:, None]
    for k in range(3):
        side = vertices[faces[:, (k + 2) % 3]] - vertices[faces[:, (k + 1) % 3]]
        growth = np.cross(unit, side) / (2.0 * total)
        for function, part in zip(slopes, means, strict=True):
            for i in range(3):
                weights = part * growth[:, i]
                function[:, i] += np.bincount(faces[:, k], weights, len(vertices))
    return slopes


def face_gradients(vertices: Floats, faces: Ints, values: Floats) -> Floats:
    """Gradient on each triangle of a function that is linear on it.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
    faces : (faces, 3) int64
    values : (vertices,) or (faces, 3) float64
        At the vertices, or at the corners of each triangle (a function with cuts).

    Returns
    -------
    (faces, 3) float64, value per length unit
        Zero on triangles without area.
    """
    a, b, c = corners_of(vertices, faces)
    normals = face_normals(vertices, faces)
    squares = np.einsum("ij,ij->i", normals, normals)
    u, v, w = (values[faces] if values.ndim == 1 else values).T
    # grad f = n x (u (c - b) + v (a - c) + w (b - a)) / |n|^2
    turned = np.cross(normals, u[:, None] * (c - b) + v[:, None] * (a - c) + w[:, None] * (b - a))
    safe = np.where(squares > 0, squares, 1.0)
    gradients: Floats = turned / safe[:, None]
    gradients[squares == 0] = 0.0
    return gradients


def step_lengths(vertices: Floats, topology: Topology) -> Floats:
    """Length from each vertex to the next; an open curve has one less than vertices."""
    ahead = np.roll(vertices, -1, axis=0) if topology == CLOSED_CURVE else vertices[1:]
    return np.asarray(np.linalg.norm(ahead - vertices[: len(ahead)], axis=1))


def curve_weights(vertices: Floats, topology: Topology) -> Floats:
    """Half the length of the steps on either side of each vertex, (vertices,) float64."""
    steps = step_lengths(vertices, topology)
    if topology == OPEN_CURVE:
        steps = np.append(steps, 0.0)
    return np.asarray((steps + np.roll(steps, 1)) / 2)


def first_at_place(vertices: FloatArray) -> Ints:
    """Find for each vertex the first one that lies exactly where it is in every frame.

    Vertices that only meet, in some frames, stay apart.

    Parameters
    ----------
    vertices : (frames, vertices, 3) float32 or float64
        Finite. 0 and -0 are the same place.

    Returns
    -------
    (vertices,) int64
        The vertex itself where no other has all of its places.
    """
    first = np.arange(vertices.shape[1])
    # Equal places have equal keys, and hardly others: of points on a lattice none.
    x, y, z = vertices[0].T.astype(np.float64)
    _, groups, counts = np.unique(
        0.31415927 * x + 0.27182818 * y + 0.17320508 * z, return_inverse=True, return_counts=True
    )
    others = np.flatnonzero(counts[groups] > 1)
    names = groups[others]
    for positions in vertices if len(others) else ():
        names = _grouped(positions[others], others, names)
    first[others] = names
    return first


def _grouped(rows: FloatArray, vertices: Ints, groups: Ints) -> Ints:
    """First vertex of those with the same row in the same group, for each; vertices increase."""
    order = np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0], groups))
    starts = np.ones(len(order), dtype=np.bool_)
    starts[1:] = groups[order[1:]] != groups[order[:-1]]
    starts[1:] |= (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    # lexsort is stable, so the first of a run is its smallest.
    names = np.empty_like(vertices)
    names[order] = vertices[order[starts]][np.cumsum(starts) - 1]
    return names


def representatives_of(vertices: FloatArray, faces: Ints) -> Ints:
    """Merge vertices that coincide in every frame, where that joins the surface.

    Vertices at one place are one where border edges are on each other (two rims, a seam), where
    a triangle repeats another, along an edge without length, and where a vertex is in no
    triangle. A surface that only touches itself in a point, or along edges that have their two
    triangles, stays as it is: joined there, it would not be a surface.

    Parameters
    ----------
    vertices : (frames, vertices, 3) float32 or float64
    faces : (faces, 3) int64

    Returns
    -------
    (vertices,) int64
        For each the first of the vertices that are one with it.
    """
    first = first_at_place(vertices)
    n = len(first)
    if (first == np.arange(n)).all():
        return first
    pairs = [
        _pairs_of_rows(first, _border(faces, n)),
        _pairs_of_rows(first, faces),
        _without_length(first, faces),
        _unused(first, faces),
    ]
    labels = pieces_of(np.concatenate(pairs, axis=1).T, n)
    _, smallest = np.unique(labels, return_index=True)
    return np.asarray(smallest[labels])


def _pairs_of_rows(first: Ints, rows: Ints) -> Ints:
    """Pairs of vertices of edges or triangles that are on each other, (2, pairs)."""
    # Each row in the order of its places, so that columns belong together.
    rows = np.take_along_axis(rows, np.argsort(first[rows], axis=1, kind="stable"), axis=1)
    places = first[rows]
    # What is a point or an edge only is on itself.
    proper = (places[:, 1:] != places[:, :-1]).all(axis=1)
    rows, places = rows[proper], places[proper]
    order = np.lexsort(places.T)
    rows, places = rows[order], places[order]
    same = (places[1:] == places[:-1]).all(axis=1)
    return np.stack([rows[:-1][same].ravel(), rows[1:][same].ravel()])


def _border(faces: Ints, n_vertices: int) -> Ints:
    """Edges of one triangle, (edges, 2)."""
    connectivity = connectivity_of(faces, n_vertices)
    return np.asarray(connectivity.edges[connectivity.faces_at_edge == 1])


def _without_length(first: Ints, faces: Ints) -> Ints:
    """Pair the ends of each edge that is in one place, (2, pairs)."""
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return np.asarray(sides[first[sides[:, 0]] == first[sides[:, 1]]].T)


def _unused(first: Ints, faces: Ints) -> Ints:
    """Vertices in no triangle, each with one at its place that is in one, (2, pairs)."""
    used = np.zeros(len(first), dtype=np.bool_)
    used[faces.ravel()] = True
    at_place = first.copy()
    # The last assignment stays: the first vertex in use, where there is one.
    backwards = np.flatnonzero(used)[::-1]
    at_place[first[backwards]] = backwards
    unused = np.flatnonzero(~used)
    return np.stack([unused, at_place[first[unused]]])
