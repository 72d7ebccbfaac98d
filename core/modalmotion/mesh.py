"""Triangle meshes: areas, boundary loops, components, gradients."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from modalmotion.topology import CLOSED, Topology


def face_areas(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Area of each triangle, (faces,) float64, length unit squared."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    areas: NDArray[np.float64] = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def vertex_areas(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Third of the area of the triangles around each vertex.

    Returns
    -------
    (vertices,) float64, length unit squared
        Zero at vertices of no triangle.
    """
    thirds = np.repeat(face_areas(vertices, faces) / 3.0, 3)
    areas: NDArray[np.float64] = np.bincount(
        faces.ravel(), weights=thirds, minlength=len(vertices)
    ).astype(np.float64)
    return areas


def boundary_loops(faces: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Edges of each boundary: those of exactly one triangle, grouped by connection.

    Returns
    -------
    list of (edges, 2) int64
        Largest number of edges first.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.sort(edges, axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    border = unique[counts == 1]
    if not len(border):
        return []
    nodes, local = np.unique(border, return_inverse=True)
    local = local.reshape(border.shape)
    n = len(nodes)
    graph = coo_array((np.ones(len(local)), (local[:, 0], local[:, 1])), shape=(n, n))
    _, component = connected_components(graph, directed=False)
    loops = [border[component[local[:, 0]] == i] for i in range(component.max() + 1)]
    return sorted(loops, key=lambda loop: (-len(loop), int(loop.min())))


def n_components(faces: NDArray[np.int64]) -> int:
    """Count the connected pieces that hold at least one triangle."""
    used, local = np.unique(faces, return_inverse=True)
    local = local.reshape(faces.shape)
    rows = np.concatenate([local[:, 0], local[:, 1]])
    columns = np.concatenate([local[:, 1], local[:, 2]])
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(used), len(used)))
    count, _ = connected_components(graph, directed=False)
    return int(count)


def euler_characteristic(faces: NDArray[np.int64]) -> int:
    """Vertices - edges + faces, over the vertices that triangles use."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    n_edges = len(np.unique(np.sort(edges, axis=1), axis=0))
    return len(np.unique(faces)) - n_edges + len(faces)


def face_gradients(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Gradient on each triangle of a function that is linear on it.

    Returns
    -------
    (faces, 3) float64, value per length unit
        Zero on triangles without area.
    """
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    twice_area_squared = (normal**2).sum(axis=1)
    u, v, w = (values[faces[:, i]] for i in range(3))
    # grad f = n x (u (c - b) + v (a - c) + w (b - a)) / |n|^2
    turned = np.cross(normal, u[:, None] * (c - b) + v[:, None] * (a - c) + w[:, None] * (b - a))
    safe = np.where(twice_area_squared > 0, twice_area_squared, 1.0)
    gradients: NDArray[np.float64] = turned / safe[:, None]
    gradients[twice_area_squared == 0] = 0.0
    return gradients


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
