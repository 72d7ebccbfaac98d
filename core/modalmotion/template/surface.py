"""Natural coordinates of triangle meshes: height along an axis and azimuth about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError
from modalmotion.mesh import (
    boundary_loops,
    euler_characteristic,
    n_components,
    vertex_areas,
)
from modalmotion.topology import CUP, CYLINDER, Topology


@dataclass(frozen=True)
class Landmarks:
    """Where the natural coordinates of a mesh sit, each found by integrals.

    Parameters
    ----------
    origin : (3,) float64, length unit
        Area centroid.
    axis : (3,) float64
        Unit vector from the origin to the centroid of the loops at the base.
    theta_zero : (3,) float64
        Unit vector across the axis in which theta is 0; theta is right-handed about the axis.
    theta_zero_strength : float
        How well the shape itself determines `theta_zero`: 0 for a surface of revolution
        (the direction is then arbitrary), near 1 where the wall leans strongly.
    n_loops : int
        Boundary loops of the mesh.
    """

    origin: NDArray[np.float64]
    axis: NDArray[np.float64]
    theta_zero: NDArray[np.float64]
    theta_zero_strength: float
    n_loops: int


# Below this share of the largest possible the direction of theta = 0 is noise.
_WEAK_THETA_ZERO = 1e-3


def natural_coordinates(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], topology: Topology | None
) -> tuple[Topology, NDArray[np.float64], Landmarks, list[str]]:
    """Find the topology of a mesh and its height and azimuth.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
    faces : (faces, 3) int64
    topology : Topology or None
        What the sender states; found from the boundary loops otherwise.

    Returns
    -------
    topology : Topology
        Cup or cylinder.
    coordinates : (vertices, 2) float64
        s from 0 at the apex (or the far loop) to 1 at the base, theta in turns.
    landmarks : Landmarks
    notes : list of str

    Raises
    ------
    TopologyError
        If the mesh is not one piece of a cup or a cylinder.
    """
    if not len(faces):
        raise TopologyError(
            f"{len(vertices)} points come without faces, grid or topology.",
            remedy="Send triangles, or the lattice as grid and topology, or say that the "
            "points are an open curve or a closed curve.",
        )
    pieces, characteristic = n_components(faces), euler_characteristic(faces)
    loops = boundary_loops(faces)
    found = (
        f"{pieces} piece(s), {len(loops)} boundary loop(s), Euler characteristic {characteristic}"
    )
    details: dict[str, object] = {
        "components": pieces,
        "boundary_loops": len(loops),
        "euler_characteristic": characteristic,
    }
    if pieces != 1 or not loops or characteristic != 2 - len(loops):
        raise TopologyError(
            f"The mesh is neither a cup nor a cylinder: {found}.",
            remedy="Send one connected surface with an opening and no handles, or a lattice.",
            details=details,
        )
    areas = vertex_areas(vertices, faces)
    if not areas.sum() > 0:
        raise TopologyError(
            "The mesh has no area, so no axis can be found on it.",
            remedy="Choose a reference frame in which the surface is not collapsed.",
            details=details,
        )
    origin = areas @ vertices / areas.sum()
    centres, lengths = zip(*(_loop_centre(vertices, loop) for loop in loops), strict=True)
    towards = np.array(centres) - origin
    opposite = len(loops) == 2 and towards[0] @ towards[1] < 0
    if topology is None:
        topology = CYLINDER if opposite else CUP
    if topology not in (CUP, CYLINDER) or (topology == CYLINDER and len(loops) != 2):
        raise TopologyError(
            f"A {topology} was stated, but the mesh has {found}.",
            remedy="State cup or cylinder (two loops), or leave the topology out.",
            details=details,
        )
    if topology == CYLINDER:
        axis = towards[0] - towards[1]
    else:
        axis = np.average(towards, axis=0, weights=lengths)
    size = np.linalg.norm(axis)
    if not size > 1e-9 * np.sqrt(areas.sum()):
        raise TopologyError(
            "The boundary is centred on the surface's own centre, so no axis can be found.",
            remedy="Send the surface as a lattice, with grid and topology.",
            details=details,
        )
    axis = axis / size
    landmarks = _landmarks(vertices - origin, areas, origin, axis, len(loops))
    notes = []
    if landmarks.theta_zero_strength < _WEAK_THETA_ZERO:
        notes.append(
            "The zero of theta is not determined by the shape; cosine and sine of a pair can "
            "only be compared together."
        )
    height = (vertices - origin) @ axis
    used = np.unique(faces)
    low, high = height[used].min(), height[used].max()
    s = (height - low) / (high - low)
    theta = _azimuth(vertices - origin, axis, landmarks.theta_zero)
    return topology, np.stack([s, theta], axis=1), landmarks, notes


def _loop_centre(
    vertices: NDArray[np.float64], loop: NDArray[np.int64]
) -> tuple[NDArray[np.float64], float]:
    a, b = vertices[loop[:, 0]], vertices[loop[:, 1]]
    lengths = np.linalg.norm(b - a, axis=1)
    total = float(lengths.sum())
    if total == 0.0:
        return a[0], 0.0
    return lengths @ ((a + b) / 2) / total, total


def _landmarks(
    offsets: NDArray[np.float64],
    areas: NDArray[np.float64],
    origin: NDArray[np.float64],
    axis: NDArray[np.float64],
    n_loops: int,
) -> Landmarks:
    # theta = 0 where the wall leans: the product moment of height and offset across the axis.
    height = offsets @ axis
    across = offsets - height[:, None] * axis
    lean = (areas * height) @ across / areas.sum()
    spread = float(np.sqrt((areas @ height**2) * (areas @ (across**2).sum(axis=1))) / areas.sum())
    strength = float(np.linalg.norm(lean)) / spread if spread > 0 else 0.0
    if strength < _WEAK_THETA_ZERO:
        lean = np.eye(3)[np.argmin(np.abs(axis))]
        lean = lean - (lean @ axis) * axis
    return Landmarks(origin, axis, lean / np.linalg.norm(lean), strength, n_loops)


def _azimuth(
    offsets: NDArray[np.float64], axis: NDArray[np.float64], zero: NDArray[np.float64]
) -> NDArray[np.float64]:
    turns: NDArray[np.float64] = np.arctan2(offsets @ np.cross(axis, zero), offsets @ zero)
    return turns / (2 * np.pi)
