"""The wall as a smooth surface: positions as functions of natural coordinates, and their slopes.

Lengths of edges grow with noise: |d + e| is larger than |d|. Positions are therefore written in few
functions of the natural coordinates, those of the closed-form modes along s and around theta, and
lengths are integrals of the slopes of that surface.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from modalmotion.errors import ParameterError, TopologyError
from modalmotion.modes.topologies import CUP, CYLINDER, SPHERE, Topology
from modalmotion.numeric.scales import orthonormal
from modalmotion.representation import Floats, Ints
from modalmotion.template import Template

# Functions along s and highest wave around, from fine to coarse: the finest of which the mesh
# shows each by four vertices, and resolves: where vertices have a gap, as about a small hole,
# fine ones take any value in it.
_SIZES: Final = ((10, 8), (8, 6), (6, 4), (5, 3), (4, 2), (3, 1))
_VERTICES_EACH: Final = 4
_CONDITION: Final = 2e3

# Natural coordinates of a mesh rise with the 5/4th power of the way from the pole: with this power
# of them positions are smooth there. Those of a lattice count its rows, and are smooth as they are.
_POWER: Final = 0.8

# Highest power of the way from a pole that waves around it start with.
_MOST_LEVEL: Final = 3

# Of the grid: Gauss nodes along the wall, equal steps around; and of the sums of lengths.
_ROWS: Final = 24
_COLUMNS: Final = 36
_STEPS: Final = 96


@dataclass(frozen=True, eq=False)
class Slopes:
    """Slopes of the smooth surface at its places, in some frames.

    Parameters
    ----------
    along, around : (places, frames, 3) float64, length unit
        Derivatives of the position by the length along the wall and by theta.
    noise : (places, 2, frames) float64, length unit squared
        Variance of each component of both from noise of the vertices.
    """

    along: Floats
    around: Floats
    noise: Floats


@dataclass(frozen=True, eq=False)
class Places:
    """A grid of places on the wall: equal shares of its length, equal steps around.

    The position along the wall is a share of the length of each line from the apex to the base, so
    that places do not depend on the mesh. Rows are at one share; they are the same lines of the
    surface in every frame.

    Parameters
    ----------
    ways : (rows,) float64
        Share of each row, from 0 at the apex to 1 at the base.
    weights : (rows,) float64
        Of quadrature; they add up to 1.
    s, theta : (rows * columns,) float64
        Natural coordinates.
    values, along, around : (rows * columns, functions) float64
        The functions, and their derivatives by the way and by theta at one way.
    """

    ways: Floats
    weights: Floats
    s: Floats
    theta: Floats
    values: Floats
    along: Floats
    around: Floats

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.ways), _COLUMNS


@dataclass(frozen=True, eq=False)
class SmoothWall:
    """Functions of the natural coordinates, fitted to vertices by least squares.

    Parameters
    ----------
    surface : Topology
    n_along, n_waves : int
        Shapes along s, and highest wave around.
    shapes : (vertices, functions) float64
    projector : (functions, vertices) float64
        coefficients = projector @ positions.
    condition : float
        Of the least squares.
    ends : (float, float)
        Of s, as far as there are vertices.
    faces : (faces, 3) int64
    """

    surface: Topology
    n_along: int
    n_waves: int
    shapes: Floats
    projector: Floats
    condition: float
    ends: tuple[float, float]
    faces: Ints

    @cached_property
    def spread(self) -> Floats:
        """Covariance of the coefficients for vertices of independent noise of variance 1."""
        covariance: Floats = self.projector @ self.projector.T
        return covariance

    @cached_property
    def middles(self) -> Floats:
        """Sums of coefficients that are the middles of both ends, (2, functions)."""
        n = self.n_waves + 1  # over one more place than waves these have no mean
        values = self._functions(np.repeat(self.ends, n), np.tile(np.arange(n) / n, 2))
        return np.asarray(values.reshape(2, n, -1).mean(axis=1), dtype=np.float64)

    def coefficients(self, positions: Floats) -> Floats:
        """Fit positions, (frames, vertices, 3) to (functions, frames, 3)."""
        fitted = np.tensordot(self.projector, positions, axes=(1, 1))
        return np.asarray(fitted, dtype=np.float64)

    def noise(self, positions: Floats, coefficients: Floats) -> Floats:
        """Mean square residual of each coordinate, (frames,)."""
        n_vertices, n_functions = self.shapes.shape
        squares = [
            float(((x - self.shapes @ coefficients[:, frame]) ** 2).sum())
            for frame, x in enumerate(positions)
        ]
        per_value: Floats = np.array(squares) / (3 * (n_vertices - n_functions))
        return per_value

    def places(self, coefficients: Floats) -> Places:
        """Place a grid by the lengths of lines from apex to base in one frame.

        Parameters
        ----------
        coefficients : (functions, 3) float64, length unit
        """
        theta = np.arange(_COLUMNS) / _COLUMNS
        s = np.linspace(*self.ends, _STEPS)
        at = np.repeat(s, _COLUMNS), np.tile(theta, _STEPS)
        slopes = np.tensordot(self._functions(*at, by="s"), coefficients, axes=1)
        speeds = np.linalg.norm(slopes, axis=1).reshape(_STEPS, _COLUMNS)
        steps = (speeds[1:] + speeds[:-1]) / 2 * (s[1] - s[0])
        lengths = np.vstack([np.zeros(_COLUMNS), np.cumsum(steps, axis=0)])
        nodes, widths = np.polynomial.legendre.leggauss(_ROWS)
        ways = (nodes + 1) / 2
        own, rates = np.empty((2, _ROWS, _COLUMNS))
        for column, length in enumerate(lengths.T):
            own[:, column] = np.interp(ways, length / length[-1], s)
            rates[:, column] = length[-1] / np.interp(own[:, column], s, speeds[:, column])
        # One s for each row, the mean of the lines: what differs between them is the noise of one
        # frame. Rates are the derivatives of s by the way, so theirs is the mean too.
        s = own.mean(axis=1).repeat(_COLUMNS)
        rate = rates.mean(axis=1).repeat(_COLUMNS)
        theta = np.tile(theta, _ROWS)
        return Places(
            ways=ways,
            weights=widths / 2,
            s=s,
            theta=theta,
            values=self._functions(s, theta),
            along=rate[:, None] * self._functions(s, theta, by="s"),
            around=self._functions(s, theta, by="theta"),
        )

    def at_heights(self, places: Places, coefficients: Floats, first: int) -> Floats:
        """Move surfaces along themselves until their rows are at the heights of one frame.

        Heights are shares of the way from the middle of one end to that of the other: those of the
        tissue stay where a wall shortens evenly along its axis, whatever its width does.

        Parameters
        ----------
        places : Places
            Of the frame `first`.
        coefficients : (functions, frames, 3) float64, length unit
        first : int

        Returns
        -------
        (functions, frames, 3) float64, length unit
        """
        # Over one more places than waves these have no mean.
        s, n = np.linspace(*self.ends, _STEPS), self.n_waves + 1
        grid = self._functions(np.repeat(s, n), np.tile(np.arange(n) / n, _STEPS))
        middles = np.tensordot(grid.reshape(_STEPS, n, -1).mean(axis=1), coefficients, axes=1)
        away = middles - middles[0]
        heights = (away * away[-1]).sum(axis=2) / (away[-1] ** 2).sum(axis=1)
        heights = np.maximum.accumulate(heights)
        wanted = np.interp(places.s, s, heights[:, first])
        Q, R = orthonormal(places.values)
        inverse, moved = np.linalg.solve(R, Q.T), np.empty_like(coefficients)
        for frame, height in enumerate(heights.T):
            values = self._functions(np.interp(wanted, height, s), places.theta)
            moved[:, frame] = inverse @ (values @ coefficients[:, frame])
        return moved

    def slopes(self, places: Places, coefficients: Floats, noise: Floats) -> Slopes:
        """Return the slopes at places, with their variance from noise.

        Parameters
        ----------
        places : Places
        coefficients : (functions, frames, 3) float64, length unit
        noise : (frames,) float64, length unit squared
            Variance of each coordinate of a vertex.
        """
        of_unit = [((G @ self.spread) * G).sum(axis=1) for G in (places.along, places.around)]
        return Slopes(
            np.asarray(np.tensordot(places.along, coefficients, axes=1), dtype=np.float64),
            np.asarray(np.tensordot(places.around, coefficients, axes=1), dtype=np.float64),
            np.stack(of_unit, axis=1)[:, :, None] * noise,
        )

    def _functions(self, s: Floats, theta: Floats, by: str = "") -> Floats:
        return _functions(self.surface, self.n_along, self.n_waves, s, theta, by)


def smooth_walls(template: Template, *, is_lattice: bool) -> tuple[SmoothWall, SmoothWall]:
    """Prepare smooth surfaces of a wall: as fine as its mesh shows, and a step coarser.

    Fewer functions reduce strain more than noise changes it, at any noise: lengths depend on
    slopes, which lose more than positions, all with one sign.

    Parameters
    ----------
    template : Template
    is_lattice : bool
        Whether the template's coordinates count rows.

    Raises
    ------
    TopologyError
        If the surface has no coordinates from a pole or an opening to another.
    ParameterError
        If the mesh has too few vertices.
    """
    if template.surface not in (CUP, CYLINDER, SPHERE):
        raise TopologyError(
            "Strain needs a wall with coordinates along and around it: a cup, a tube or a sphere.",
            remedy="Set topology=cup if the surface is a ventricle's wall, open at its base.",
        )
    n = int((template.weights > 0).sum())
    needed = [_VERTICES_EACH * _n_functions(*size, template.surface) for size in _SIZES]
    sizes = [size for size, least in zip(_SIZES, needed, strict=True) if least <= n]
    if not sizes:
        raise ParameterError(
            f"The wall has {n} vertices; strain needs {needed[-1]}.",
            remedy="Send a finer mesh.",
            details={"vertices": n, "least": needed[-1]},
        )
    fitted = (_fitted(template, *size, is_lattice=is_lattice) for size in sizes)
    fine = next((wall for wall in fitted if wall.condition <= _CONDITION), None)
    if fine is None:
        raise ParameterError(
            "The vertices leave a gap in which the wall is undetermined.",
            remedy="Send a more uniform mesh.",
        )
    return fine, next(fitted, fine)


def _fitted(template: Template, n_along: int, n_waves: int, *, is_lattice: bool) -> SmoothWall:
    surface = template.topology
    counts = template.weights > 0
    coordinates, weights = template.coordinates[counts], template.weights[counts]
    s = coordinates[:, 0] if is_lattice else coordinates[:, 0] ** _POWER
    own = _functions(surface, n_along, n_waves, s, coordinates[:, 1])
    root = np.sqrt(weights)[:, None]
    Q, R = orthonormal(root * own)
    shapes = np.zeros((template.n_vertices, own.shape[1]))
    shapes[counts] = own
    projector = np.zeros(shapes.T.shape)
    projector[:, counts] = np.linalg.solve(R, (root * Q).T)
    return SmoothWall(
        surface=surface,
        n_along=n_along,
        n_waves=n_waves,
        shapes=shapes,
        projector=projector,
        condition=float(np.linalg.cond(R)),
        ends=(
            float(s.min()) if surface == CYLINDER else 0.0,
            1.0 if surface == SPHERE else float(s.max()),
        ),
        faces=template.faces,
    )


def _n_functions(n_along: int, n_waves: int, surface: Topology) -> int:
    # Beside the cosines a power of s for each open end.
    n_open = {CUP: 1, CYLINDER: 2, SPHERE: 0}[surface]
    return (n_along + n_open) * (2 * n_waves + 1)


def _functions(
    surface: Topology, n_along: int, n_waves: int, s: Floats, theta: Floats, by: str = ""
) -> Floats:
    """Evaluate the functions or a derivative of them, (places, functions)."""
    columns = []
    for wave in range(n_waves + 1):
        A = _along(surface, wave, n_along, s, slope=by == "s")
        turn = 2 * np.pi * wave * theta
        cosine, sine = np.cos(turn), np.sin(turn)
        if by == "theta":
            cosine, sine = -2 * np.pi * wave * sine, 2 * np.pi * wave * cosine
        columns.append(A * cosine[:, None])
        if wave:
            columns.append(A * sine[:, None])
    return np.concatenate(columns, axis=1)


def _along(surface: Topology, wave: int, n: int, s: Floats, *, slope: bool) -> Floats:
    """Evaluate cosines along s, and a power of s for the slope at each open end.

    A pole is one point, so a wave around it starts there as a power of the way (as r^m cos(m theta)
    about the middle of a disc): cosines times a power of a sine that is 0 at poles. For waves 0 and
    1 these span the shapes of the closed-form modes. Those of free ends are level there, a wall is
    not: without the powers of s the series converges slowly.
    """
    k = np.pi * np.arange(n)
    cosines, sines = np.cos(k * s[:, None]), -k * np.sin(k * s[:, None])
    power = 0 if surface == CYLINDER else min(wave, _MOST_LEVEL)
    turn = np.pi if surface == SPHERE else np.pi / 2
    rise = np.sin(turn * s)[:, None]
    shapes = rise**power * (sines if slope else cosines)
    if slope and power:
        shapes += power * rise ** (power - 1) * turn * np.cos(turn * s)[:, None] * cosines
    own = {SPHERE: (), CYLINDER: (1, 2)}.get(surface, (power or 2,))
    ends = [q * s ** (q - 1) if slope else s**q for q in own]
    return np.column_stack([shapes, *ends])
