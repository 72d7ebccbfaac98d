"""Areas, normals and gradients of triangles.

All take vertices whose squares neither overflow nor vanish: `make_template` scales them first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def face_normals(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
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


def corners_of(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places of the first, second and third corners, each (faces, 3) and a copy."""
    # `take` reads a vertex at once; indexing, or axis by axis, takes three times as long where
    # neighbours lie far apart in memory.
    first, second, third = (np.take(vertices, faces[:, i], axis=0) for i in range(3))
    return first, second, third


def face_areas(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Area of each triangle, (faces,) float64, length unit squared."""
    normals = face_normals(vertices, faces)
    areas: NDArray[np.float64] = 0.5 * np.sqrt(np.einsum("ij,ij->i", normals, normals))
    return areas


def vertex_areas(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Third of the area of the triangles around each vertex.

    Returns
    -------
    (vertices,) float64, length unit squared
        Zero at vertices in no triangle.
    """
    thirds = np.repeat(face_areas(vertices, faces) / 3.0, 3)
    areas: NDArray[np.float64] = np.bincount(
        faces.ravel(), weights=thirds, minlength=len(vertices)
    ).astype(np.float64)
    return areas


def mean_slopes(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    values: NDArray[np.float64],
    gradients: NDArray[np.float64],
) -> NDArray[np.float64]:
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
    slopes: NDArray[np.float64] = gradients * shares[:, None]
    for k in range(3):
        side = vertices[faces[:, (k + 2) % 3]] - vertices[faces[:, (k + 1) % 3]]
        growth = np.cross(unit, side) / (2.0 * total)
        for function, part in zip(slopes, means, strict=True):
            for i in range(3):
                weights = part * growth[:, i]
                function[:, i] += np.bincount(faces[:, k], weights, len(vertices))
    return slopes


def face_gradients(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
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
    gradients: NDArray[np.float64] = turned / safe[:, None]
    gradients[squares == 0] = 0.0
    return gradients
