"""Lengths of a surface along its natural coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import face_areas, face_gradients
from modalmotion.topology import CLOSED, Topology


def axis_lengths(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    topology: Topology,
    grid: tuple[int, ...] | None,
    coordinates: NDArray[np.float64],
) -> tuple[float, ...]:
    """Length along each axis: the reciprocal of the mean gradient of its coordinate.

    An integral over the surface, so it does not hang on single vertices. On a cup the
    circumference is then its area over its meridian.

    Returns
    -------
    tuple of float, length unit
        0 along an axis without extent.
    """
    if topology.n_axes == 2 and len(faces):
        areas = face_areas(vertices, faces)
        if areas.sum() > 0:
            return tuple(
                _from_gradients(vertices, faces, areas, coordinates[:, axis], ends == CLOSED)
                for axis, ends in enumerate(topology.ends)
            )
    if grid is None:
        return (0.0,) * topology.n_axes
    return tuple(
        _from_steps(vertices.reshape(*grid, 3), axis, ends == CLOSED)
        for axis, ends in enumerate(topology.ends)
    )


def _from_gradients(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    areas: NDArray[np.float64],
    coordinate: NDArray[np.float64],
    closed: bool,
) -> float:
    if not closed:
        slope = np.linalg.norm(face_gradients(vertices, faces, coordinate), axis=1)
    else:
        # Each triangle is unwrapped about its first corner, given its own three vertices.
        corners = coordinate[faces]
        corners = corners - corners[:, :1]
        corners -= np.round(corners)
        own = np.arange(faces.size).reshape(faces.shape)
        slope = np.linalg.norm(
            face_gradients(vertices[faces].reshape(-1, 3), own, corners.ravel()), axis=1
        )
    mean = float((areas * slope).sum() / areas.sum())
    return 1.0 / mean if mean > 0 else 0.0


def _from_steps(nodes: NDArray[np.float64], axis: int, closed: bool) -> float:
    n = nodes.shape[axis]
    ahead = np.roll(nodes, -1, axis=axis) if closed else np.take(nodes, range(1, n), axis=axis)
    here = nodes if closed else np.take(nodes, range(n - 1), axis=axis)
    steps = np.linalg.norm(ahead - here, axis=-1)
    return float(steps.mean() * n) if steps.size else 0.0
