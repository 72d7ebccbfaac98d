"""Symmetric matrices by their diagonal and the entries right of it, and their solution.

Multigrid of `multigrid`, compiled: the cycle in single precision, sweeps that push what is below
the diagonal ahead, conjugate gradients around it in double precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.machine import Kernels
from modalmotion.mesh.sides import Sides
from modalmotion.progress import ShareReport, share_fallen, silent

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.uint32]

# `multigrid` says what each means; here sweeps cost less, and some numbers are others.
_STRONG: Final = 0.08
_OMEGA: Final = 4.0 / 3.0
_POWER_STEPS: Final = 8
_COARSEST: Final = 400
_MOST_LEVELS: Final = 20
_MOST_STEPS: Final = 80
_LOOK_AT: Final = 15
_FALLEN: Final = 1e-4
_SET_UP: Final = 0.3

# Of the error, over the solution, both in energy: the largest error is at most a few times that,
# for on a surface the energy bounds values but for the root of a logarithm.
_TOLERANCE: Final = 1e-12


@dataclass(frozen=True, eq=False)
class HalfMatrix:
    """Symmetric matrix.

    Parameters
    ----------
    first : (n + 1,) uint32
        Where each row begins.
    end : (entries,) uint32
        Columns right of the diagonal.
    weight : (entries,) float64
    diagonal : (n,) float64
    kernels : Kernels
    """

    first: Indices
    end: Indices
    weight: Floats
    diagonal: Floats
    kernels: Kernels

    @classmethod
    def of(cls, sides: Sides, weights: Floats) -> HalfMatrix:
        """Give the matrix whose rows add up to zero."""
        n = sides.n_vertices
        diagonal = np.zeros(n)
        sides.kernels.run("add_weights", n, sides.first, sides.end, weights, diagonal)
        return cls(sides.first, sides.end, weights, diagonal, sides.kernels)

    def __len__(self) -> int:
        return len(self.diagonal)

    def times(self, x: Floats) -> Floats:
        """Multiply with a vector, (n,) float64."""
        image, sums = np.zeros(len(self)), np.zeros(1)
        self._multiply(x, image, sums)
        return image

    def free(self, number: Indices, n_free: int) -> HalfMatrix:
        """Keep some rows and columns.

        Parameters
        ----------
        number : (n,) uint32
            Of those that are kept, from 0 in their order; `n_free` of others.
        n_free : int
        """
        first = np.zeros(n_free + 1, dtype=np.uint32)
        end, weight = np.empty_like(self.end), np.empty_like(self.weight)
        own = self.first, self.end, self.weight, number
        n = self.kernels.run("keep_free", len(self), *own, n_free, first, end, weight)
        return HalfMatrix(first, end[:n], weight[:n], self.diagonal[number != n_free], self.kernels)

    def _multiply(self, x: Floats, image: Floats, sums: Floats) -> None:
        own = self.first, self.end, self.weight, self.diagonal
        self.kernels.run("multiply", len(self), *own, x, image, sums)


def solve_half(matrix: HalfMatrix, right: Floats, report: ShareReport = silent) -> Floats | None:
    """Solve a large sparse symmetric positive definite system.

    Parameters
    ----------
    matrix : HalfMatrix
        Neighbouring unknowns near each other.
    right : (n,) float64
    report : callable, optional
        Told the share of the solution that is there.

    Returns
    -------
    (n,) float64, or None
        None where it converges too slowly, as on long thin triangles.
    """
    run, n = matrix.kernels.run, len(matrix)
    x, residual = np.zeros(n), right.astype(np.float64)
    start = float(np.sqrt((right * right).sum()))
    if not start > 0:
        return x
    if not (matrix.diagonal > 0).all():
        return None
    cycle = _Cycle.of(matrix)
    if cycle is None:
        return None
    report(_SET_UP)
    direction, image, sums = np.zeros(n), np.zeros(n), np.zeros(1)
    single = np.empty(n, dtype=np.float32)
    before, left, largest, done = 1.0, start, 0.0, 0.0
    for number in range(_MOST_STEPS):
        # Near 1, whatever the unit: single precision ends at 1e-38.
        scale = np.sqrt(n) / left
        run("scaled_to", n, residual, float(scale), single)
        z = cycle(single)
        run("turn_to", n, residual, z, sums)
        now = float(sums[0] / scale)
        # The residual times its approximate solution is the square of the error's energy.
        largest = max(largest, now)
        if 0 <= now <= _TOLERANCE**2 * largest:
            return x
        if not now > 0 or (number == _LOOK_AT and now > _FALLEN**2 * largest):
            return None
        done = max(done, share_fallen(now, largest, _TOLERANCE**2 * largest))
        report(_SET_UP + (1 - _SET_UP) * done)
        run("redirect", n, now / before, z, float(1.0 / scale), direction)
        before = now
        matrix._multiply(direction, image, sums)
        if not sums[0] > 0:
            return None
        run("step_along", n, now / float(sums[0]), direction, image, x, residual, sums)
        left = float(np.sqrt(sums[0]))
    return None


@dataclass(frozen=True, eq=False)
class _Level:
    """A matrix in single precision, interpolation from the next, and room."""

    matrix: tuple[Indices, Indices, Singles, Singles]
    x: Singles
    pushed: Singles
    interpolation: tuple[Indices, Indices, Singles]
    coarse: Singles


@dataclass(frozen=True, eq=False)
class _Cycle:
    """One V-cycle: forward sweeps down, backward sweeps up, so that it is symmetric."""

    levels: tuple[_Level, ...]
    coarsest: Floats
    kernels: Kernels

    @classmethod
    def of(cls, matrix: HalfMatrix) -> _Cycle | None:
        levels: list[_Level] = []
        while len(matrix) > _COARSEST and len(levels) < _MOST_LEVELS:
            found = _coarser(matrix)
            if found is None:
                return None
            level, matrix = found
            levels.append(level)
        if len(matrix) > _COARSEST:
            return None
        whole = np.diag(matrix.diagonal)
        rows = np.repeat(np.arange(len(matrix)), np.diff(matrix.first))
        whole[rows, matrix.end] = whole[matrix.end, rows] = matrix.weight
        try:
            inverse: Floats = np.linalg.inv(whole).astype(np.float64)
        except np.linalg.LinAlgError:
            return None
        return cls(tuple(levels), inverse, matrix.kernels)

    def __call__(self, right: Singles) -> Singles:
        """Give an approximate solution for a right-hand side."""
        given = []
        for level in self.levels:
            given.append(right)
            level.coarse[:] = 0.0
            self._sweep("go_down", level, right)
            right = level.coarse
        coarse: Singles = (self.coarsest * right).sum(axis=1).astype(np.float32)
        for level, right in zip(reversed(self.levels), reversed(given), strict=True):
            level.coarse[:] = coarse
            self._sweep("go_up", level, right)
            coarse = level.x
        return coarse

    def _sweep(self, name: str, level: _Level, right: Singles) -> None:
        interpolation = *level.interpolation, level.coarse
        n = len(right)
        self.kernels.run(name, n, *level.matrix, right, level.x, level.pushed, *interpolation)


def _coarser(matrix: HalfMatrix) -> tuple[_Level, HalfMatrix] | None:
    """Make a level and the matrix of the next."""
    run, n, n_entries = matrix.kernels.run, len(matrix), len(matrix.end)
    start = np.zeros(n + 2, dtype=np.uint32)
    column, value = np.empty(2 * n_entries, dtype=np.uint32), np.empty(2 * n_entries)
    run("whole_rows", n, matrix.first, matrix.end, matrix.weight, start, column, value)
    rows = start, column, value, matrix.diagonal
    group = np.full(n, n, dtype=np.uint32)
    n_groups = run("group_unknowns", n, *rows, _STRONG, group)
    if not 0 < n_groups < 0.9 * n:
        return None
    omega = _OMEGA / _radius(matrix)
    p_start = np.empty(n + 1, dtype=np.uint32)
    # Most of this room is never touched.
    room = n + 2 * n_entries
    p_group, p_value = np.empty(room, dtype=np.uint32), np.empty(room)
    n_p = run("smooth_groups", n, *rows, group, omega, p_start, p_group, p_value)
    p_group, p_value = p_group[:n_p].copy(), p_value[:n_p].copy()
    t_start = np.zeros(n_groups + 2, dtype=np.uint32)
    t_row, t_value = np.empty(n_p, dtype=np.uint32), np.empty(n_p)
    run("turn_over", n, n_groups, p_start, p_group, p_value, t_start, t_row, t_value)
    first, place = np.empty(n_groups + 1, np.uint32), np.zeros(n_groups, np.uint32)
    end, weight = np.empty(n_entries, dtype=np.uint32), np.empty(n_entries)
    diagonal = np.empty(n_groups)
    a_start, a_group = np.empty(n + 1, dtype=np.uint32), np.empty(room, dtype=np.uint32)
    image = a_start, a_group, np.empty(room)
    given = *rows, p_start, p_group, p_value, place
    if run("image_rows", n, *given, *image, room) < 0:
        return None
    place[:] = 0
    coarse = place, first, end, weight, diagonal, n_entries
    n_coarse = run("coarser", n_groups, t_start, t_row, t_value, *image, *coarse)
    if n_coarse < 0 or not (diagonal > 0).all():
        return None
    level = _Level(
        (
            matrix.first,
            matrix.end,
            matrix.weight.astype(np.float32),
            (1.0 / matrix.diagonal).astype(np.float32),
        ),
        np.zeros(n, dtype=np.float32),
        np.zeros(n, dtype=np.float32),
        (p_start, p_group, p_value.astype(np.float32)),
        np.zeros(n_groups, dtype=np.float32),
    )
    parts = first, end[:n_coarse].copy(), weight[:n_coarse].copy(), diagonal
    return level, HalfMatrix(*parts, matrix.kernels)


def _radius(matrix: HalfMatrix) -> float:
    """Largest eigenvalue of the matrix over its diagonal, by powers from a fixed beginning."""
    inverse, n = 1.0 / matrix.diagonal, len(matrix)
    x = np.random.default_rng(0).uniform(0.5, 1.5, n)
    x *= np.where(np.arange(n) % 2, 1.0, -1.0)
    value = 1.0
    for _ in range(_POWER_STEPS):
        x = inverse * matrix.times(x)
        value = float(np.sqrt((x * x).sum()))
        x /= value
    return value
