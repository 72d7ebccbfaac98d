"""Laplacians of triangle meshes: of the surface, and of its springs alone."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh.areas import corners_of, face_normals


def cotangent_laplacian(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> scipy.sparse.csc_array:
    """Stiffness of linear elements: minus the Laplacian, weighted by cotangents.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
    faces : (faces, 3) int64

    Returns
    -------
    (vertices, vertices) scipy.sparse.csc_array of float64
        Positive semidefinite and independent of the unit; triangles without area and
        vertices without triangles contribute nothing.

    Notes
    -----
    Pinkall and Polthier, Computing discrete minimal surfaces and their conjugates,
    Experimental Mathematics, 1993.
    """
    n = len(vertices)
    corners = corners_of(vertices, faces)
    normals = face_normals(vertices, faces)
    twice_area = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    safe = np.where(twice_area > 0, twice_area, np.inf)
    rows, columns, values = [], [], []
    for k in range(3):
        b, c = faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        # cot of the angle at a weighs the side bc
        to_b, to_c = (corners[(k + i) % 3] - corners[k] for i in (1, 2))
        to_b *= to_c
        dot = to_b[:, 0] + to_b[:, 1] + to_b[:, 2]
        rows.append(np.minimum(b, c))
        columns.append(np.maximum(b, c))
        values.append(-0.5 * dot / safe)
    return _symmetric(n, np.concatenate(rows), np.concatenate(columns), np.concatenate(values))


def graph_laplacian(edges: NDArray[np.int64], n_vertices: int) -> scipy.sparse.csc_array:
    """Stiffness of equal springs along the edges: degree minus adjacency.

    Parameters
    ----------
    edges : (edges, 2) int64
        Each once.
    n_vertices : int

    Returns
    -------
    (vertices, vertices) scipy.sparse.csc_array of float64
    """
    return _symmetric(n_vertices, edges[:, 0], edges[:, 1], np.full(len(edges), -1.0))


def divergence(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], field: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Flux of a field out of each vertex's cell: the stiffness applied to its potential.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
    faces : (faces, 3) int64
    field : (faces, 3) float64, value per length unit
        Constant on each triangle; where it is the gradient of f, the result is
        cotangent_laplacian @ f.

    Returns
    -------
    (vertices,) float64, value
    """
    total = np.zeros(len(vertices))
    normals = face_normals(vertices, faces)
    twice_area = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    unit = normals / np.where(twice_area > 0, twice_area, np.inf)[:, None]
    for k in range(3):
        a, b, c = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        # area * grad(hat of a) = n x (c - b) / 2
        turned = np.cross(unit, vertices[c] - vertices[b])
        total += np.bincount(
            a, weights=0.5 * np.einsum("ij,ij->i", turned, field), minlength=len(vertices)
        )
    return total


def _symmetric(
    n: int,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    values: NDArray[np.float64],
) -> scipy.sparse.csc_array:
    off = scipy.sparse.csc_array((values, (rows, columns)), shape=(n, n))
    off = off + off.T
    diagonal = -np.asarray(off.sum(axis=0)).ravel()
    return scipy.sparse.csc_array(
        off + scipy.sparse.csc_array((diagonal, (np.arange(n), np.arange(n))), shape=(n, n)),
    )
