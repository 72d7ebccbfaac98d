"""A lattice of each topology in space, for users without a surface of their own."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import (
    CLOSED,
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    Topology,
    lattice_coordinates,
)


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


# Circumference one turn of radius 1; the axis 0.55 of it, as in the order of modes.
_AXIS: Final = 0.55 * 2.0 * np.pi
_TUBE: Final = 0.45


def standard_surface(lattice: Lattice) -> MeshSequence:
    """Place a lattice in space, radius 1.

    Parameters
    ----------
    lattice : Lattice
        A curve or a surface.

    Returns
    -------
    MeshSequence
        One frame, without a unit: a straight line, a circle, a flat plane, a tube, a torus, half
        a spheroid or a sphere.

    Raises
    ------
    TopologyError
        If its topology is another.
    """
    topology = lattice.topology
    coordinates = lattice_coordinates(topology, lattice.shape)
    s, theta = coordinates[:, 0], 2.0 * np.pi * coordinates[:, -1]
    if topology == OPEN_CURVE:
        x = _points(_AXIS * (s - 0.5), 0.0 * s, 0.0 * s)
    elif topology == CLOSED_CURVE:
        x = _points(np.cos(theta), np.sin(theta), 0.0 * s)
    elif topology == PLANE:
        x = _points(theta - np.pi, _AXIS * (s - 0.5), 0.0 * s)
    elif topology == CYLINDER:
        x = _points(np.cos(theta), np.sin(theta), _AXIS * (s - 0.5))
    elif topology == TORUS:
        tube = 2.0 * np.pi * s
        r = 1.0 + _TUBE * np.cos(tube)
        x = _points(r * np.cos(theta), r * np.sin(theta), _TUBE * np.sin(tube))
    elif topology == CUP:
        nu = 0.5 * np.pi * s
        r = np.sin(nu)
        x = _points(r * np.cos(theta), r * np.sin(theta), -2.0 * np.cos(nu))
    elif topology == SPHERE:
        r = np.sin(np.pi * s)
        x = _points(r * np.cos(theta), r * np.sin(theta), -np.cos(np.pi * s))
    else:
        raise TopologyError(
            f"A lattice {topology} is not a surface.",
            remedy="Use an open or closed curve, plane, cylinder, torus, cup or sphere.",
        )
    faces = lattice_faces(topology, lattice.shape) if topology.n_axes == 2 else None
    return mesh_sequence(x[None], faces, grid=lattice.shape, topology=topology)


def _points(*columns: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack(columns, axis=1)
