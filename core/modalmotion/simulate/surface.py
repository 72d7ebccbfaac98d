"""The surface of a simulated ventricle: shape at rest, vertices and triangles, and pose.

A material point is a polar angle nu (rad, 0 at the apex) and an azimuth theta (rad).
"""

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from modalmotion import errors, mesh
from modalmotion.modes.topologies import CUP, lattice_coordinates, require_shape
from modalmotion.representation import Floats, Ints, shown

_N_TABLE: Final = 4001


class Spacing(StrEnum):
    """Quantity that is equal between the rows of a lattice."""

    ARC = "arc length"
    HEIGHT = "height"


@dataclass(frozen=True)
class Spheroid:
    """A prolate spheroid cut at its base.

    Parameters
    ----------
    length : float, mm
        From apex to base.
    radius : float, mm
        Of the widest section.
    truncation : float, rad
        Polar angle of the base.
    """

    length: float
    radius: float
    truncation: float

    def radius_at(self, nu: Floats) -> Floats:
        """Distance from the axis, mm."""
        r: Floats = self.radius * np.sin(nu)
        return r

    def height_at(self, nu: Floats) -> Floats:
        """Distance from the apex along the axis, mm."""
        # 1 - cos nu = 2 sin^2(nu / 2), without cancellation at the apex.
        z: Floats = 2.0 * self._semi_axis * np.sin(nu / 2) ** 2
        return z

    def slope_at(self, nu: Floats) -> Floats:
        """Height over polar angle, mm per rad."""
        slope: Floats = self._semi_axis * np.sin(nu)
        return slope

    def speed_at(self, nu: Floats) -> Floats:
        """Arc length of the meridian over polar angle, mm per rad."""
        speed: Floats = np.hypot(self.radius * np.cos(nu), self.slope_at(nu))
        return speed

    @property
    def area(self) -> float:
        """Area of the wall, mm^2."""
        ring = 2 * np.pi * self.radius_at(self._angles) * self.speed_at(self._angles)
        return float(_running_integral(ring, self._angles)[-1])

    def polar_angle(self, share: Floats, spacing: Spacing) -> Floats:
        """Polar angle at a share (0 apex, 1 base) of the meridian's arc length or of the height."""
        if spacing == Spacing.HEIGHT:
            x = share * np.sin(self.truncation / 2) ** 2
            nu: Floats = 2.0 * np.arcsin(np.sqrt(x))
            return nu
        return np.asarray(np.interp(share, self._arc / self._arc[-1], self._angles))

    def polar_angle_of_area(self, share: Floats) -> Floats:
        """Polar angle below which a share of the area is."""
        # The area grows as nu^2 at the apex; its root interpolates well there.
        ring = self.radius_at(self._angles) * self.speed_at(self._angles)
        area = _running_integral(ring, self._angles)
        return np.asarray(np.interp(np.sqrt(share), np.sqrt(area / area[-1]), self._angles))

    def isothermal_radius(self, nu: Floats) -> Floats:
        """Radius of the conformal map of the surface to the unit disc, 1 at the base."""
        # d ln rho / d nu = ds/dnu / r; its pole, 1/tan nu times the length at the apex, is
        # integrated in closed form.
        angles = self._angles
        rest = np.zeros_like(angles)
        rest[1:] = (self.speed_at(angles[1:]) / self.radius - 1.0) / np.sin(angles[1:])
        log_rho = _running_integral(rest, angles)
        log_rho = np.interp(nu, angles, log_rho) - log_rho[-1]
        rho: Floats = (np.tan(nu / 2) / np.tan(self.truncation / 2)) * np.exp(log_rho)
        return rho

    @property
    def _semi_axis(self) -> float:
        return self.length / (1.0 - float(np.cos(self.truncation)))

    @cached_property
    def _angles(self) -> Floats:
        return np.linspace(0.0, self.truncation, _N_TABLE)

    @cached_property
    def _arc(self) -> Floats:
        return _running_integral(self.speed_at(self._angles), self._angles)


def directions(nu: Floats, theta: Floats) -> Floats:
    """Return unit vectors (..., 3): material points seen from the middle of a sphere.

    Any smooth function of them is a smooth function on the surface, at the apex too.
    """
    x, y = np.sin(nu) * np.cos(theta), np.sin(nu) * np.sin(theta)
    return np.stack([x, y, -np.cos(nu)], axis=-1)


def _running_integral(values: Floats, at: Floats) -> Floats:
    steps = (values[1:] + values[:-1]) / 2 * np.diff(at)
    return np.concatenate([[0.0], np.cumsum(steps)])


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

    polar_angles: Floats
    azimuths: Floats
    faces: Ints
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
    require_shape(CUP, grid)
    coordinates = lattice_coordinates(CUP, grid)
    return Points(
        spheroid.polar_angle(coordinates[:, 0], spacing),
        2 * np.pi * coordinates[:, 1],
        mesh.lattice_faces(CUP, grid),
        grid,
    )


def triangle_points(spheroid: Spheroid, n_vertices: int, rng: "np.random.Generator") -> Points:
    """Irregular triangulation with the apex as a vertex and a loop of vertices at the base.

    Evenly spread over the area along a spiral, displaced at random, and joined by Delaunay's
    rule in the conformal image of the surface, which keeps the triangles' angles.

    Raises
    ------
    ParameterError
        If there are too few or too many vertices.
    """
    if not _FEWEST_VERTICES <= n_vertices <= _MOST_VERTICES:
        raise errors.ParameterError(
            f"A triangulation of {n_vertices} vertices was requested.",
            remedy=f"Use {_FEWEST_VERTICES} to {_MOST_VERTICES} vertices.",
        )
    # A loop of n_loop vertices as far apart as the others: circumference / sqrt(area / n).
    rim = float(spheroid.radius_at(np.asarray(spheroid.truncation)))
    area = spheroid.area
    n_loop = max(8, round(2 * np.pi * rim / float(np.sqrt(area / n_vertices))))
    n_inner = n_vertices - n_loop - 1
    if n_inner < 8:
        raise errors.ParameterError(
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


@shown()
@dataclass(frozen=True)
class Pose:
    """Position and slow rigid motion of the whole surface.

    Parameters
    ----------
    rotation : (float, float, float), rad
        Rotation vector from the body frame, about the middle of the axis.
    translation : (float, float, float), mm
    drift_rotation : (float, float, float), rad
        Rotation vector that comes and goes once a beat, on top.
    drift_translation : (float, float, float), mm
        Translation that comes and goes once a beat, on top.

    Raises
    ------
    ParameterError
        If an entry is not finite.
    """

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_translation: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        entries = (self.rotation, self.translation, self.drift_rotation, self.drift_translation)
        if not np.isfinite(entries).all():
            raise errors.ParameterError(
                f"The pose {entries} is not four finite vectors.",
                remedy="Give three finite numbers for each.",
            )

    def place(self, vertices: Floats, beats: Floats, middle: Floats) -> Floats:
        """Transform vertices from the body frame to the scanner's.

        Parameters
        ----------
        vertices : (frames, vertices, 3) float64, mm
        beats : (frames,) float64
            Time of each frame in beats.
        middle : (3,) float64, mm
            Fixed point of the rotations in the body frame.

        Returns
        -------
        (frames, vertices, 3) float64, mm
        """
        drift = (1.0 - np.cos(2 * np.pi * beats)) / 2
        fixed = rotation_matrix(np.asarray(self.rotation))
        placed = np.empty_like(vertices)
        for frame, share in enumerate(drift):
            turn = fixed @ rotation_matrix(share * np.asarray(self.drift_rotation))
            placed[frame] = (vertices[frame] - middle) @ turn.T
            placed[frame] += share * np.asarray(self.drift_translation)
        placed += middle + np.asarray(self.translation)
        return placed


def rotation_matrix(vector: Floats) -> Floats:
    """Rotation by |vector| rad about a vector, (3, 3) float64."""
    return np.asarray(
        scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix(), dtype=np.float64
    )


def random_rotation(rng: "np.random.Generator") -> tuple[float, float, float]:
    """Rotation vector of a rotation drawn evenly from all of them."""
    turn = scipy.spatial.transform.Rotation.from_quat(np.roll(rng.standard_normal(4), -1))
    x, y, z = turn.as_rotvec().tolist()
    return x, y, z
