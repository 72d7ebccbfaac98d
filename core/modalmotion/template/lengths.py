"""Lengths of a surface along its natural coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import face_areas, face_gradients
from modalmotion.mesh.triangles import step_lengths
from modalmotion.modes.topology import CLOSED, End, Topology
from modalmotion.template.coordinates.axis import corner_steps
from modalmotion.template.surface import Surface


def axis_lengths(
    surface: Surface,
    topology: Topology,
    grid: tuple[int, ...] | None,
    coordinates: NDArray[np.float64],
) -> tuple[float, ...]:
    """Length along each axis: the reciprocal of the mean gradient of its coordinate.

    An integral over the surface, so it does not hang on single vertices. Around a pole, where
    that gradient has no bound, it is the area over the meridian, which is the same on a surface
    of revolution.

    Returns
    -------
    tuple of float, length unit
        0 along an axis without extent.
    """
    if topology.n_axes == 1 and grid is None:
        return (float(step_lengths(surface.vertices, topology).sum()),)
    if topology.n_axes == 2 and surface.area > 0:
        first = _from_gradients(surface, coordinates[:, 0], topology.ends[0] == CLOSED)
        if End.POLE in topology.ends[0]:
            return first, surface.area / first if first > 0 else 0.0
        return first, _from_gradients(surface, coordinates[:, 1], topology.ends[1] == CLOSED)
    if grid is None:
        return (0.0,) * topology.n_axes
    return tuple(
        _from_steps(surface.vertices.reshape(*grid, 3), axis, ends == CLOSED)
        for axis, ends in enumerate(topology.ends)
    )


def _from_gradients(surface: Surface, coordinate: NDArray[np.float64], closed: bool) -> float:
    areas = face_areas(surface.vertices, surface.faces)
    values = corner_steps(coordinate, surface.faces) if closed else coordinate
    gradients = face_gradients(surface.vertices, surface.faces, values)
    mean = float((areas * np.linalg.norm(gradients, axis=1)).sum() / areas.sum())
    return 1.0 / mean if mean > 0 else 0.0


def _from_steps(nodes: NDArray[np.float64], axis: int, closed: bool) -> float:
    n = nodes.shape[axis]
    ahead = np.roll(nodes, -1, axis=axis) if closed else np.take(nodes, range(1, n), axis=axis)
    here = nodes if closed else np.take(nodes, range(n - 1), axis=axis)
    steps = np.linalg.norm(ahead - here, axis=-1)
    return float(steps.mean() * n) if steps.size else 0.0
