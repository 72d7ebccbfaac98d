"""A surface or curve that deforms in its closed-form modes, and the rims of its openings."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.mesh import geometry, triangles
from modalmotion.modes import ModeSet, lowest_modes, topologies, whole_count
from modalmotion.representation import Bools, Floats, Ints
from modalmotion.template import Template, body_frame
from modalmotion.template.template import shapes_of
from modalmotion.tracking import closest, observation

# Of the stiffness of its modes, that of an even contraction.
_EVEN: Final = 0.1


@dataclass(frozen=True, eq=False)
class Deformable:
    """Positions x = x0 + Phi a, superposition (2) on a reference shape.

    Parameters
    ----------
    template : Template
        Of the reference shape x0.
    modes : ModeSet
    shapes : (vertices, modes) float64
        Phi, or what `exact_for_affine` makes of it.
    wavenumbers : (modes,) float64, 1
        |k| on the template's own lengths, times their geometric mean, so that no unit is left.
    """

    template: Template
    modes: ModeSet
    shapes: Floats
    wavenumbers: Floats

    @staticmethod
    def of(template: Template, n_modes: int) -> "Deformable":
        """Take the lowest modes of a template, rounded up so that no pair is split."""
        modes = lowest_modes(template.topology, whole_count(template.topology, n_modes))
        k = modes.wavenumbers_on(template.lengths)
        length = float(np.exp(np.log(np.array(template.lengths)).mean()))
        return Deformable(template, modes, shapes_of(modes, template), k * length)

    def exact_for_affine(self) -> "Deformable":
        """Let what the modes leave of an affine motion go with its amplitudes.

        What is even, as most of a heart's contraction is, then leaves nothing.
        """
        return replace(self, shapes=body_frame.affine_shapes(self.shapes, self.template))

    def __len__(self) -> int:
        return len(self.modes)

    def positions(self, amplitudes: Floats) -> Floats:
        """Positions, (vertices, 3), for amplitudes (modes, 3)."""
        return self.template.vertices + (self.shapes @ amplitudes)

    @cached_property
    def _even(self) -> Floats:
        """Amplitudes, (3 modes,), of the motion away from the middle, as far as modes show it.

        Of an open surface that from its axis: along it the rim would move, which few data hold.
        """
        x, w, axes = self.template.vertices, self.template.weights[:, None], self.template.topology
        away = x - (w * x).sum(axis=0)
        if axes.ends[-1] != topologies.CLOSED:
            away = 0.0 * away
        elif topologies.End.OPEN in axes.ends[0]:
            axis = away.T @ (w[:, 0] * self.template.coordinates[:, 0])
            axis /= np.linalg.norm(axis)
            away -= np.outer(away @ axis, axis)
        found: Floats = np.linalg.lstsq(w**0.5 * self.shapes, w**0.5 * away)[0]
        return found.ravel()

    def stiffness(self, variances: Floats) -> Floats:
        """Inverse of the prior's covariance of amplitudes, (3 modes, 3 modes).

        Modes are independent, with variances (modes,), but that an even contraction costs a tenth:
        where nothing is seen a surface contracts with the rest, and does not stand still.
        """
        own = np.repeat(1.0 / variances, 3)
        pull = own * self._even
        energy = float(self._even @ pull)
        share = (1.0 - _EVEN) / energy if energy > 0 else 0.0
        return np.diag(own) - share * np.outer(pull, pull)

    @cached_property
    def size(self) -> float:
        """RMS distance of the reference from its centroid, length unit."""
        x, w = self.template.vertices, self.template.weights[:, None]
        r = x - (w * x).sum(axis=0)
        return float(np.sqrt((w * r * r).sum()))

    @cached_property
    def area(self) -> float:
        """Area of the reference, length unit squared; of a curve its length."""
        x = self.template.vertices[self.cells]
        sides = x[:, 1:] - x[:, :1]
        if self.cells.shape[1] == 2:
            return float(np.linalg.norm(sides[:, 0], axis=1).sum())
        return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2.0

    @cached_property
    def cells(self) -> Ints:
        """Triangles, (cells, 3), or segments of a curve, (cells, 2)."""
        if self.template.topology.n_axes > 1:
            a, b, c = self.template.faces.T
            proper: Ints = self.template.faces[(a != b) & (b != c) & (c != a)]
            return proper
        n = self.template.n_vertices
        start = np.arange(n if self.template.topology.ends[0] == topologies.CLOSED else n - 1)
        return np.stack([start, (start + 1) % n], axis=1)

    @cached_property
    def rim(self) -> Bools:
        """Vertices where the surface ends, (vertices,)."""
        rim = np.zeros(self.template.n_vertices, dtype=np.bool_)
        if self.template.topology == topologies.OPEN_CURVE:
            rim[[0, -1]] = True
        rim[self.rim_sides[0]] = True
        return rim

    @cached_property
    def rim_sides(self) -> tuple[Ints, Ints]:
        """Sides of triangles without a neighbour, and their third corners; none of a curve."""
        none = np.zeros((0, 3), dtype=np.int64)
        return observation.open_sides(self.cells if self.cells.shape[1] == 3 else none)


# Share of the area in triangles turned against their neighbours. A single sliver may turn.
_MOST_FOLDED = 0.01


# Of the largest: a cavity that encloses less is none.
_LEAST_VOLUME = 0.01


def require_volume(cavity: mesh.Cavity | None, vertices: Floats) -> None:
    """Check that a surface that encloses a volume does so in every frame.

    Parameters
    ----------
    cavity : Cavity or None
        None of what encloses none.
    vertices : (frames, vertices, 3) float64, length unit

    Raises
    ------
    ShapeError
        Naming the frame whose volume is less than 1 % of the largest.
    """
    if cavity is None or len(vertices) < 2:
        return
    volumes = np.abs(cavity.volume(vertices))
    frame, largest = int(volumes.argmin()), float(volumes.max())
    if volumes[frame] < _LEAST_VOLUME * largest:
        raise errors.ShapeError(
            f"In frame {frame} the surface collapses: it encloses "
            f"{volumes[frame] / largest:.2%} of its largest volume.",
            remedy="Omit the frame if its points lie in one plane or on one side, or check "
            "the topology and the unit of each frame.",
            frame=frame,
            details={"share": float(volumes[frame]) / largest},
        )


def require_unfolded(surface: Deformable, vertices: Floats) -> None:
    """Check that no frame has folds that the start has not.

    Parameters
    ----------
    surface : Deformable
    vertices : (frames, vertices, 3) float64, length unit

    Raises
    ------
    ShapeError
        Naming the first frame with more than 1 % of the area turned over that was not so at first.
    """
    if surface.cells.shape[1] != 3:
        return
    # A faithful mesh may have sharp folds of its own.
    at_rest = _turned(surface, surface.template.vertices)[0]
    for frame, x in enumerate(vertices):
        turned, areas = _turned(surface, x)
        folded = float(areas[turned & ~at_rest].sum() / (areas.sum() or 1.0))
        if not folded <= _MOST_FOLDED:
            raise errors.ShapeError(
                f"In frame {frame} the surface folds over itself over {folded:.0%} of its area: "
                "the data do not fit a surface of this topology from this start.",
                remedy="Check the landmarks and the topology, ask for fewer modes, or give a "
                "starting surface close to the data.",
                frame=frame,
                details={"folded": folded},
            )


def _turned(surface: Deformable, x: Floats) -> tuple[Bools, Floats]:
    """Triangles turned against their neighbours, and the areas of all."""
    own = triangles.face_normals(x, surface.cells)
    around = geometry.vertex_normals(x, surface.cells)[surface.cells].sum(axis=1)
    return (own * around).sum(axis=1) < 0, np.linalg.norm(own, axis=1)


NEAR_END: Final = 0.25
"""Of the axis: openings this near to an end are that end's."""

# Three sectors tell a level and a tilt.
_FEWEST_SECTORS: Final = 3


@dataclass(frozen=True, eq=False)
class Rim:
    """All openings at one end of a surface, in sectors about its axis.

    Parameters
    ----------
    sides : (sides, 2) int64
        Of triangles, along the openings.
    opposite : (sides,) int64
        Third corner of each one's triangle.
    sectors : (vertices,) int64
        Sector of each vertex of the surface.
    distances : (vertices,) float64, length unit
        Of each vertex of the start from the rim.
    n_sectors : int
    """

    sides: Ints
    opposite: Ints
    sectors: Ints
    distances: Floats
    n_sectors: int

    def at(self, x: Floats) -> tuple[Floats, Floats]:
        """Take the rim of a surface with the vertices x, (vertices, 3).

        Returns
        -------
        outward : (2 sides, 3) float64, length unit
            Out of the surface and across the halves of its sides, as long as these.
        totals : (sectors,) float64, length unit
            Length of the rim in each.
        """
        a, b, c = x[self.sides[:, 0]], x[self.sides[:, 1]], x[self.opposite]
        side, away = b - a, (a + b) / 2.0 - c
        lengths = np.linalg.norm(side, axis=1)
        share = (away * side).sum(axis=1) / np.where(lengths > 0, lengths, 1.0) ** 2
        away -= share[:, None] * side
        size = np.linalg.norm(away, axis=1)
        outward = np.repeat(away * (lengths / 2.0 / np.where(size > 0, size, 1.0))[:, None], 2, 0)
        halves = np.repeat(lengths / 2.0, 2)
        totals = np.bincount(self.sectors[self.sides].ravel(), halves, minlength=self.n_sectors)
        return outward, totals.astype(np.float64)

    def rows(self, surface: Deformable, x: Floats, n_values: float) -> tuple[Floats, Floats]:
        """How amplitudes move each sector, and how much alike what they leave is along it.

        Returns
        -------
        rows : (sectors, modes, 3) float64
            That amplitudes move it outward by in the mean.
        alike : (sectors,) float64
            Variance of its mean, over that of one place, of what the modes leave.
        """
        outward, totals = self.at(x)
        rows, alike = np.zeros((self.n_sectors, len(surface), 3)), np.zeros(self.n_sectors)
        vertices, lengths = self.sides.ravel(), np.linalg.norm(outward, axis=1)
        for k, total in enumerate(totals):
            own = self.sectors[vertices] == k
            rows[k] = surface.shapes[vertices[own]].T @ outward[own] / total
            alike[k] = alike_over(surface, vertices[own], lengths[own] / total, n_values)
        return rows, alike


def rim_of(surface: Deformable, end: str, width: float) -> Rim | None:
    """Take the openings at an end in sectors about `width` long.

    Parameters
    ----------
    surface : Deformable
    end : {"apex", "base"}
    width : float, length unit

    Returns
    -------
    Rim or None
        None if the surface has no opening there, or a small one.
    """
    sides, opposite = rim_at(surface, end)
    x, axes = surface.template.vertices, surface.template.topology.ends
    if not len(sides) or len(axes) != 2 or axes[1] != topologies.CLOSED:
        return None
    length = float(np.linalg.norm(x[sides[:, 1]] - x[sides[:, 0]], axis=1).sum())
    n = round(length / width)
    if n < _FEWEST_SECTORS:
        return None
    sectors = np.floor(surface.template.coordinates[:, 1] % 1.0 * n).astype(np.int64) % n
    if len(np.unique(sectors[sides[:, 0]])) < n:
        return None
    return Rim(sides, opposite, sectors, closest.closest_points(x, x, sides).distances, n)


def rim_at(surface: Deformable, end: str) -> tuple[Ints, Ints]:
    """Sides of triangles along the opening at an end of the axis; none without one.

    Returns
    -------
    sides : (sides, 2) int64
    opposite : (sides,) int64
        Third corner of each one's triangle.
    """
    template = surface.template
    sides, opposite = surface.rim_sides
    # At a pole the rows of a lattice leave a hole that is none.
    first, last = template.topology.ends[0]
    if not len(sides) or (first if end == "apex" else last) != topologies.End.OPEN:
        return sides[:0], opposite[:0]
    s = template.coordinates[:, 0]
    at_end = (np.abs(s - (0.0 if end == "apex" else 1.0)) < NEAR_END)[sides].all(axis=1)
    return sides[at_end], opposite[at_end]


def alike_over(surface: Deformable, vertices: Ints, shares: Floats, n_values: float) -> float:
    """Variance of a mean over places, over that of one place, of what the modes leave.

    Parameters
    ----------
    surface : Deformable
    vertices : (n,) int64
    shares : (n,) float64
        Of each in the mean; they add up to 1.
    n_values : float
        Independent values of it on the whole surface.

    Returns
    -------
    float
        1 of one place, 1 / n_values of the whole surface: the middle of a ring is known better
        than a point, as the ring passes through several patches.

    Notes
    -----
    A correlation exp(-pi (d / l)^2) has the integral l^2 over a surface, and l along a curve. Of
    a mean over the whole surface, of the area A, it leaves l^2 / A, which is 1 / n_values:
    l^2 = A / n_values, of a curve l = L / n_values. Distances are those of the reference.
    """
    x = surface.template.vertices[vertices]
    squares = ((x[:, None] - x) ** 2).sum(axis=2)
    length = (surface.area / n_values) ** (1.0 / surface.template.topology.n_axes)
    alike = np.exp(-np.pi * squares / length**2)
    return float((shares[:, None] * shares * alike).sum())


def place_on(surface: Deformable, place: observation.Place) -> tuple[Ints, Floats]:
    """Vertices of a landmark's place, and their shares in it.

    Raises
    ------
    ParameterError
        If the surface has no such place.
    """
    template = surface.template
    if isinstance(place, str):
        vertices, shares = _named(surface, place)
    else:
        vertices = np.atleast_1d(np.asarray(place, dtype=np.int64))
        shares = np.full(len(vertices), 1.0 / max(1, len(vertices)))
    if not len(vertices) or not 0 <= vertices.min() <= vertices.max() < template.n_vertices:
        raise errors.ParameterError(
            f"The landmark {place!r:.60} is not a place on the surface, which is a "
            f"{template.topology} with {template.n_vertices} vertices.",
            remedy="Name apex or base where the surface has such an end, or vertices of the start.",
        )
    return vertices, shares


def _named(surface: Deformable, name: str) -> tuple[Ints, Floats]:
    """Mean of the vertices at an end of the axis: of a rim by length, of a pole alike."""
    template = surface.template
    none = np.zeros(0, dtype=np.int64)
    if name not in ("apex", "base") or not template.coordinates.shape[1]:
        return none, np.zeros(0)
    s, x = template.coordinates[:, 0], template.vertices
    sides, _ = surface.rim_sides
    sides = sides[(np.abs(s - (0.0 if name == "apex" else 1.0)) < NEAR_END)[sides].all(axis=1)]
    if len(sides):
        length = np.linalg.norm(x[sides[:, 0]] - x[sides[:, 1]], axis=1)
        total = np.bincount(sides.ravel(), np.repeat(length, 2), minlength=len(x))
        vertices = np.flatnonzero(total)
        return vertices, total[vertices] / total.sum()
    end = s.min() if name == "apex" else s.max()
    vertices = np.flatnonzero(np.abs(s - end) <= 1e-9)
    return vertices, np.full(len(vertices), 1.0 / len(vertices))
