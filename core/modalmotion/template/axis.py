"""Axes and potentials of a surface, from integrals."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np
import scipy

from modalmotion import errors, mesh
from modalmotion.mesh.triangles import mean_slopes
from modalmotion.modes.topologies import CLOSED, CUP, CYLINDER, Topology
from modalmotion.progress import Reporter, silent
from modalmotion.representation import Floats, Ints
from modalmotion.template.landmarks import Coordinates, Landmarks
from modalmotion.template.surfaces import Opening, Surface, corner_steps

# An axis through two places closer than this share of the surface's size has no direction.
_SHORTEST = 1e-9


@dataclass(frozen=True, eq=False)
class Axes:
    """Directions that natural coordinates are placed by.

    Parameters
    ----------
    axis : (3,) float64
        Unit vector; the normal of a plane.
    zero : (3,) float64
        Unit vector across it, in which theta is 0; along s of a plane.
    strengths : mapping of str to float
        How well each is determined, 0 to 1: see `Landmarks`.
    """

    axis: Floats
    zero: Floats
    strengths: Mapping[str, float]

    @property
    def matrix(self) -> Floats:
        """The two and the one across both in the columns of a rotation, (3, 3)."""
        return np.stack([self.zero, np.cross(self.axis, self.zero), self.axis], axis=1)

    def turned(self, w: Floats) -> "Axes":
        """Turn both by the rotation vector w, (3,), rad."""
        R = scipy.spatial.transform.Rotation.from_rotvec(w).as_matrix()
        return Axes(R @ self.axis, R @ self.zero, self.strengths)


def direction_between(surface: Surface, apex: Floats, base: Floats) -> Floats:
    """Find the unit vector from one place to another, (3,).

    Raises
    ------
    ParameterError
        If the two places coincide.
    """
    span = base - apex
    size = float(np.linalg.norm(span))
    if not size > _SHORTEST * np.sqrt(surface.area):
        raise errors.ParameterError(
            "The apex and the base coincide, so they define no axis.",
            remedy="Give two places at opposite ends of the surface.",
        )
    return np.asarray(span / size)


def origin_on(surface: Surface, axis: Floats, places: Mapping[str, Floats]) -> Floats:
    """Foot of the area centroid on the axis through a stated end; the centroid without one."""
    place = places.get("apex", places.get("base"))
    if place is None:
        return surface.centroid
    return np.asarray(place + ((surface.centroid - place) @ axis) * axis)


def principal_axes(surface: Surface) -> tuple[Floats, Floats]:
    """Directions in which the surface extends most to least, and its variance along them.

    The sense of each is that in which the surface is blunt: its third moment along it is
    not positive.

    Returns
    -------
    variances : (3,) float64
    directions : (3, 3) float64
        One in each row.
    """
    offsets, areas = surface.offsets, surface.areas
    variances, columns = np.linalg.eigh(surface.covariance)
    directions = columns.T[::-1].copy()
    for direction in directions:
        if (areas * (offsets @ direction) ** 3).sum() > 0:
            direction *= -1
    return np.maximum(variances[::-1], 0.0), directions


def skewness(surface: Surface, direction: Floats) -> float:
    """Strength of the third moment that gives a direction its sense, 0 to 1."""
    cubes = surface.areas * (surface.offsets @ direction) ** 3
    total = float(np.abs(cubes).sum())
    return abs(float(cubes.sum())) / total if total > 0 else 0.0


def lean(surface: Surface, axis: Floats) -> tuple[Floats, float]:
    """Direction across the axis in which the wall leans, and how strongly, 0 to 1.

    The product moment of height and offset across the axis. It turns with the surface, is
    the same for any triangulation, and vanishes on a surface of revolution.
    """
    of_axis = surface.covariance @ axis
    high = float(of_axis @ axis)
    wide = float(np.trace(surface.covariance)) - high
    return _unit_across(of_axis, axis, float(np.sqrt(max(high * wide, 0.0))))


def widest_across(surface: Surface, axis: Floats) -> tuple[Floats, float]:
    """Direction across the axis in which the surface is widest, and how strongly, 0 to 1.

    For an axis of inertia, along which nothing leans. Its sense is that of `principal_axes`.
    """
    across = np.eye(3) - np.outer(axis, axis)
    variances, columns = np.linalg.eigh(across @ surface.covariance @ across)
    direction: Floats = columns[:, 2]
    if float((surface.areas * (surface.offsets @ direction) ** 3).sum()) > 0:
        direction = -direction
    gap = float((variances[2] - variances[1]) / variances[2]) if variances[2] > 0 else 0.0
    direction, strength = _unit_across(direction * gap, axis, 1.0)
    return direction, min(strength, skewness(surface, direction))


def towards(place: Floats, origin: Floats, axis: Floats, size: float) -> Floats:
    """Find the unit vector across the axis towards a place.

    Raises
    ------
    ParameterError
        If the place is on the axis.
    """
    across = place - origin
    across = across - (across @ axis) * axis
    length = float(np.linalg.norm(across))
    if not length > 1e-6 * size:
        raise errors.ParameterError(
            "The landmark 'theta_zero' is on the axis, where theta is undefined.",
            remedy="Give a place on the wall, away from apex and axis.",
        )
    return np.asarray(across / length)


def axes_about(
    surface: Surface,
    places: Mapping[str, Floats],
    axis: Floats,
    by_shape: tuple[Floats, float],
    strengths: Mapping[str, float],
) -> Axes:
    """Axes of a known axis, and the zero of theta on it.

    Parameters
    ----------
    surface : Surface
    places : mapping of str to (3,) float64
        Positions of the stated landmarks; "theta_zero" decides where it is one of them.
    axis : (3,) float64
    by_shape : (3,) float64 and float
        `lean` or `widest_across`: how the shape decides otherwise.
    strengths : mapping of str to float
        Of the axis.
    """
    zero, strength = by_shape
    if "theta_zero" in places:
        origin = origin_on(surface, axis, places)
        zero, strength = towards(places["theta_zero"], origin, axis, surface.area**0.5), 1.0
    return Axes(axis, zero, {**strengths, "theta_zero": strength})


def landmarks_at(
    surface: Surface,
    places: Mapping[str, Floats],
    axes: Axes,
    origin: Floats,
    apex: Floats,
    base: Floats,
    strengths: Mapping[str, float] = MappingProxyType({}),
) -> Landmarks:
    """Landmarks on known axes: apex and base as stated, or else these."""
    return Landmarks(
        origin=origin,
        axis=axes.axis,
        theta_zero=axes.zero,
        apex=places.get("apex", apex),
        base=places.get("base", base),
        strengths={**axes.strengths, **strengths},
        n_loops=len(surface.openings),
        given=tuple(places),
    )


def height_along(offsets: Floats, axis: Floats) -> Floats:
    """Height along an axis from 0 to 1, for triangles that are too thin to solve on."""
    height = offsets @ axis
    return np.asarray((height - height.min()) / (np.ptp(height) or 1.0))


def azimuth(offsets: Floats, axis: Floats, zero: Floats) -> Floats:
    """Angle about the axis in turns, (-1/2, 1/2], right-handed for either winding of the mesh.

    Parameters
    ----------
    offsets : (vertices, 3) float64
        From a point of the axis.
    axis, zero : (3,) float64
        Unit vectors across each other.

    Returns
    -------
    (vertices,) float64, turns
    """
    beside = np.cross(axis, zero).astype(np.float64)
    turns: Floats = np.arctan2(offsets @ beside, offsets @ zero)
    return turns / (2 * np.pi)


def n_vortices(theta: Floats, faces: Ints) -> int:
    """Triangles around which theta makes a whole turn: where the axis meets the surface."""
    corners = theta[faces]
    steps = np.roll(corners, -1, axis=1) - corners
    return int((np.abs(np.round(steps).sum(axis=1)) > 0).sum())


def degree(surface: Surface, coordinates: Floats, topology: Topology) -> float:
    """How many times the coordinates cover their rectangle, folds counted backwards.

    1 where every place has its own pair of coordinates; less where theta turns back on itself
    or the axis meets the surface outside the poles.
    """
    faces = surface.wound_faces
    if faces is None:
        return 0.0
    x, y = (
        corner_steps(column, faces) if ends == CLOSED else column[faces] - column[faces][:, :1]
        for column, ends in zip(coordinates.T, topology.ends, strict=True)
    )
    return abs(0.5 * float((x[:, 1] * y[:, 2] - x[:, 2] * y[:, 1]).sum()))


def any_across(axis: Floats) -> Floats:
    """Choose some unit vector across the axis, where the shape offers none."""
    one = np.eye(3)[np.argmin(np.abs(axis))]
    one = one - (one @ axis) * axis
    return np.asarray(one / np.linalg.norm(one))


def _unit_across(direction: Floats, axis: Floats, spread: float) -> tuple[Floats, float]:
    direction = direction - (direction @ axis) * axis
    length = float(np.linalg.norm(direction))
    strength = min(1.0, length / spread) if spread > 0 else 0.0
    # Rounding alone leaves this much of a direction.
    if not strength > 1e-12:
        return any_across(axis), 0.0
    return direction / length, strength


# Springs this weak join vertices that no triangle with area joins.
_GLUE = 1e-12


def potential(
    surface: Surface, sources: Floats, held: Ints, values: Floats, report: Reporter = silent
) -> Floats | None:
    """Solve -Laplace u = sources with u fixed on some vertices, by linear elements.

    Parameters
    ----------
    surface : Surface
        In one piece.
    sources : (vertices,) float64
        Integrated over each vertex's cell.
    held : (n,) int64
        Vertices with a fixed value; if there are none, the sources must add up to zero and
        the mean of u over the surface is zero.
    values : (n,) float64
    report : callable, optional
        Told the share of the solution that is there.

    Returns
    -------
    (vertices,) float64, or None
        None if the triangles are too thin for a solution. Isolated vertices get zero.
    """
    n = len(surface.vertices)
    u = np.zeros(n)
    u[held] = values
    is_free = np.ones(n, dtype=np.bool_)
    is_free[np.concatenate([held, surface.isolated])] = False
    free = np.flatnonzero(is_free)
    if not len(held):
        # Without held values u is known up to a constant: one vertex is held, the mean
        # taken off afterwards.
        free = free[1:]
    if len(free):
        stiffness = _stiffness(surface)
        right = sources[free] - (stiffness @ u)[free]
        try:
            u[free] = mesh.solve_positive_definite(stiffness[free][:, free], right, report)
        except RuntimeError:
            return None
    if not np.isfinite(u).all():
        return None
    if not len(held):
        u -= (surface.areas * u).sum() / surface.area
    return u


def _stiffness(surface: Surface) -> "scipy.sparse.csc_array":
    stiffness = mesh.cotangent_laplacian(surface.vertices, surface.faces)
    if (np.delete(surface.areas, surface.isolated) > 0).all():
        return stiffness
    diagonal = stiffness.diagonal()
    springs = mesh.graph_laplacian(surface.connectivity.edges, len(surface.vertices))
    return scipy.sparse.csc_array(stiffness + _GLUE * float(diagonal.max(initial=1.0)) * springs)


Places = dict[str, Floats]


# Step of a difference, on a surface of about size 1.
_STEP: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Placement:
    """Axes of a template, and what they and its coordinates come from.

    Parameters
    ----------
    topology : Topology
    surface, mean : Surface
        The reference, and the mean of all frames in the same place.
    places, mean_places : mapping of str to (3,) float64, scaled
        Stated landmarks on each.
    vertices : mapping of str to int
        Those of them that name a vertex, which is the one on the surface.
    scale : float, length unit
        Of the surfaces.
    axes_of, make : callable
        Find axes on a surface with its places; make coordinates about axes.
    """

    topology: Topology
    surface: Surface
    mean: Surface
    places: Places
    mean_places: Places
    vertices: Mapping[str, int]
    scale: float
    axes_of: Callable[[Surface, Places], Axes]
    make: Callable[..., Coordinates | None]

    @cached_property
    def axes(self) -> Axes:
        """Those of the mean of all frames."""
        return self.axes_of(self.mean, self.mean_places)

    def coordinates(self, axes: Axes, before: Floats) -> Floats:
        """Coordinates about other axes, (vertices, axes) float64, like those about its own."""
        surface = self.surface
        if self.topology in (CUP, CYLINDER):
            # Their s is of the openings.
            origin = origin_on(surface, axes.axis, self.places)
            theta = azimuth(surface.vertices - origin, axes.axis, axes.zero)
            return np.stack([before[:, 0], theta], axis=1)
        found = self.make(surface, self.places, axes)
        return before if found is None else found.values

    def slopes(self) -> Floats:
        """Turn of the axes by errors of the mean's positions.

        The axes follow from area integrals up to the second moment, from the centres of the
        openings and from stated vertices: differences by these, times the slopes of these.

        Returns
        -------
        (3, vertices, 3) float64, rad per length unit
            Of the rotation vector by each position, in the order of the mesh.
        """
        mean, C, o = self.mean, self.mean.covariance, self.mean.offsets
        k = self._turns(lambda step: {"centroid": mean.centroid + step})
        K = np.stack(
            [
                self._turns(lambda step, e=e: {"covariance": C + _symmetric(e, step)})  # type: ignore[misc]
                for e in np.eye(3)
            ],
            axis=1,
        )
        # The area mean of f = k . o + o'K o has these slopes.
        f = k @ o.T + np.einsum("vi,wij,vj->wv", o, K, o)
        slopes = mean_slopes(mean.vertices, mean.faces, f, k[:, None] + 2.0 * o @ K)
        for number, opening in enumerate(mean.openings):

            def changed(
                step: Floats, n: int = number, one: Opening = opening
            ) -> dict[str, tuple[Opening, ...]]:
                other = replace(one, centre=one.centre + step[:3], length=one.length + step[3])
                return {"openings": (*mean.openings[:n], other, *mean.openings[n + 1 :])}

            turns = self._turns(changed, n=4)
            slopes += opening.slopes(mean.vertices, turns[:, :3], turns[:, 3])
        for name, vertex in self.vertices.items():
            slopes[:, vertex] += self._turns(lambda _: {}, name)
        return slopes / self.scale

    def _turns(
        self, changed: Callable[[Floats], Mapping[str, object]], place: str = "", n: int = 3
    ) -> Floats:
        """Rotation vector by each direction of a step in parts of the mean, or in a place."""
        before, columns = self.axes.matrix, []
        for step in _STEP * np.eye(n):
            other, places = copy.copy(self.mean), dict(self.mean_places)
            # Instead of what the surface would work out.
            vars(other).update(changed(step))
            if place:
                places[place] = places[place] + step
            W = self.axes_of(other, places).matrix @ before.T
            columns.append([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]])
        return np.array(columns).T / (2.0 * _STEP)


def _symmetric(a: Floats, b: Floats) -> Floats:
    return 0.5 * (np.outer(a, b) + np.outer(b, a))
