"""Vertices and triangles of a simulated surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.mesh import lattice_faces
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CUP
from modalmotion.simulate.spheroid import Spacing, Spheroid

_FEWEST_VERTICES: Final = 50
_MOST_VERTICES: Final = 200_000

_GOLDEN_ANGLE: Final = np.pi * (3.0 - np.sqrt(5.0))

# Random displacement of the vertices of a triangulation, as a share of their distance.
_JITTER: Final = 0.25


@dataclass(frozen=True, eq=False)
class Points:
    """Material points and the triangles between them.

    Parameters
    ----------
    polar_angles, azimuths : (points,) float64, rad
    faces : (faces, 3) int64
        Wound outward.
    grid : tuple of int or None
        Shape of the lattice; None for an irregular triangulation.
    """

    polar_angles: NDArray[np.float64]
    azimuths: NDArray[np.float64]
    faces: NDArray[np.int64]
    grid: tuple[int, int] | None


def lattice_points(
    spheroid: Spheroid, grid: tuple[int, int], spacing: Spacing = Spacing.ARC
) -> Points:
    """Nodes of a cup lattice: row 0 next to the apex, columns right-handed about the axis.

    Raises
    ------
    ShapeError
        If the grid is not that of a cup: its columns must be even in number.
    """
    coordinates = Lattice(CUP, grid).natural_coordinates
    return Points(
        spheroid.polar_angle(coordinates[:, 0], spacing),
        2 * np.pi * coordinates[:, 1],
        lattice_faces(CUP, grid),
        grid,
    )


def triangle_points(spheroid: Spheroid, n_vertices: int, rng: np.random.Generator) -> Points:
    """Irregular triangulation with the apex as a vertex and a loop of vertices at the base.

    Evenly spread over the area along a spiral, displaced at random, and joined by Delaunay's
    rule in the conformal image of the surface, which keeps the triangles' angles.

    Raises
    ------
    ParameterError
        If there are too few or too many vertices.
    """
    if not _FEWEST_VERTICES <= n_vertices <= _MOST_VERTICES:
        raise ParameterError(
            f"A triangulation of {n_vertices} vertices was requested.",
            remedy=f"Use {_FEWEST_VERTICES} to {_MOST_VERTICES} vertices.",
        )
    # A loop of n_loop vertices as far apart as the others: circumference / sqrt(area / n).
    rim = float(spheroid.radius_at(np.asarray(spheroid.truncation)))
    area = spheroid.area
    n_loop = max(8, round(2 * np.pi * rim / float(np.sqrt(area / n_vertices))))
    n_inner = n_vertices - n_loop - 1
    if n_inner < 8:
        raise ParameterError(
            f"{n_vertices} vertices are too few for a base of {n_loop}.",
            remedy="Use more vertices, or a narrower base.",
        )
    k = np.arange(1, n_inner + 1).astype(np.float64)
    # Half a strip's area is left free along the rim.
    nu = spheroid.polar_angle_of_area((k + 0.5) / (n_inner + 1 + 0.6 * n_loop))
    theta = k * _GOLDEN_ANGLE
    step = float(np.sqrt(area / n_vertices))
    r = spheroid.radius_at(nu)
    nu = nu + _JITTER * step / spheroid.speed_at(nu) * rng.uniform(-1.0, 1.0, n_inner)
    nu = np.clip(
        nu, 0.3 * step / spheroid.radius, spheroid.truncation - 0.4 * step / spheroid.radius
    )
    theta = theta + _JITTER * step / r * rng.uniform(-1.0, 1.0, n_inner)
    loop = 2 * np.pi * (np.arange(n_loop) + rng.uniform(-_JITTER, _JITTER, n_loop)) / n_loop
    nu = np.concatenate([[0.0], nu, np.full(n_loop, spheroid.truncation)])
    theta = np.concatenate([[0.0], theta, loop])
    rho = spheroid.isothermal_radius(nu)
    disc = np.stack([rho * np.cos(theta), rho * np.sin(theta)], axis=1)
    faces = scipy.spatial.Delaunay(disc).simplices.astype(np.int64)
    ab, ac = disc[faces[:, 1]] - disc[faces[:, 0]], disc[faces[:, 2]] - disc[faces[:, 0]]
    turn = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    # Counterclockwise in the disc faces the cavity.
    faces = np.where(turn[:, None] > 0, faces[:, ::-1], faces)
    return Points(nu, np.mod(theta, 2 * np.pi), np.ascontiguousarray(faces), None)
