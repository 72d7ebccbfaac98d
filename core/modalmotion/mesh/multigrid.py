"""Iterative solution of large sparse systems on surfaces, by algebraic multigrid.

Conjugate gradients, preconditioned by a V-cycle of smoothed aggregation (Vanek, Mandel and
Brezina, Algebraic multigrid by smoothed aggregation, Computing, 1996): groups of strongly joined
unknowns are the unknowns of the next level, whose interpolation is a step of Jacobi away from a
constant on each group. Memory grows as the matrix; groups and sweeps are in `native/multigrid.c`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.native import run
from modalmotion.progress import ShareReport, share_fallen, silent

Floats = NDArray[np.float64]

# Couplings below this share of the diagonals join no group: with less, thin triangles slow it.
_STRONG: Final = 0.08
# Of the Jacobi step, over the largest eigenvalue.
_OMEGA: Final = 4.0 / 3.0
_POWER_STEPS: Final = 15
_COARSEST: Final = 500
_MOST_LEVELS: Final = 20

# Of the residual, over that of zero. What is slower than so many steps is better solved directly.
_TOLERANCE: Final = 1e-13
_MOST_STEPS: Final = 60
# By this step it must have fallen so far: it takes 25 for all on triangles of usual shape.
_LOOK_AT: Final = 15
_FALLEN: Final = 1e-4

# Of the time, until there are levels.
_SET_UP: Final = 0.3


def solve_by_multigrid(
    matrix: scipy.sparse.csc_array, right: Floats, report: ShareReport = silent
) -> Floats | None:
    """Solve a sparse symmetric positive definite system.

    Parameters
    ----------
    matrix : (n, n) scipy.sparse.csc_array of float64
    right : (n,) float64
    report : callable, optional
        Told the share of the solution that is there.

    Returns
    -------
    (n,) float64, or None
        None where it converges too slowly, as on long thin triangles.
    """
    # The rows of a symmetric matrix are its columns.
    A = scipy.sparse.csr_matrix(
        (matrix.data, matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)),
        shape=matrix.shape,
    )
    diagonal = A.diagonal()
    if not (diagonal > 0).all():
        return None
    cycle = _Cycle.of(A)
    x = np.zeros(len(right))
    residual = right.copy()
    direction = np.zeros_like(x)
    before, done = 1.0, 0.0
    start = float(np.linalg.norm(right))
    for number in range(_MOST_STEPS):
        left = float(np.linalg.norm(residual))
        if left <= _TOLERANCE * start:
            return x
        done = max(done, share_fallen(left, start, _TOLERANCE * start))
        report(_SET_UP + (1 - _SET_UP) * done)
        if number == _LOOK_AT and left > _FALLEN * start:
            return None
        z = cycle(residual)
        now = float(residual @ z)
        if not now > 0:
            return None
        direction *= now / before
        direction += z
        before = now
        image = A @ direction
        step = now / float(direction @ image)
        x += step * direction
        residual -= step * image
    return None


@dataclass(frozen=True)
class _Level:
    A: Any
    P: Any
    R: Any


@dataclass(frozen=True)
class _Cycle:
    """One V-cycle: forward sweeps down, backward sweeps up, so that it is symmetric."""

    levels: tuple[_Level, ...]
    coarsest: Any

    @classmethod
    def of(cls, A: Any) -> _Cycle:
        levels: list[_Level] = []
        constant = np.ones(A.shape[0])
        while A.shape[0] > _COARSEST and len(levels) < _MOST_LEVELS:
            groups = _groups(A)
            if not 0 < groups.shape[1] < A.shape[0]:
                break
            T, constant = _tentative(groups, constant)
            inverse = scipy.sparse.diags_array(1.0 / A.diagonal())
            P = scipy.sparse.csr_matrix(T - (_OMEGA / _radius(A)) * (inverse @ (A @ T)))
            R = scipy.sparse.csr_matrix(P.T)
            levels.append(_Level(A, P, R))
            A = scipy.sparse.csr_matrix(R @ A @ P)
        return cls(tuple(levels), scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(A)))

    def __call__(self, residual: Floats) -> Floats:
        """Give an approximate solution for a right-hand side."""
        return self._solve(0, residual)

    def _solve(self, number: int, right: Floats) -> Floats:
        if number == len(self.levels):
            solved: Floats = self.coarsest.solve(right)
            return solved
        level = self.levels[number]
        x = np.zeros(len(right))
        _sweep(level.A, x, right, backward=False)
        x += level.P @ self._solve(number + 1, level.R @ (right - level.A @ x))
        _sweep(level.A, x, right, backward=True)
        return x


def _groups(A: Any) -> Any:
    """Put strongly joined unknowns into groups, (unknowns, groups)."""
    n, diagonal, entries = A.shape[0], A.diagonal(), A.tocoo()
    a, b = entries.row, entries.col
    is_strong = (entries.data**2 >= _STRONG**2 * diagonal[a] * diagonal[b]) & (a != b)
    near = scipy.sparse.csr_matrix((np.ones(is_strong.sum()), (a[is_strong], b[is_strong])), (n, n))
    group = np.empty(n, dtype=np.int32)
    n_groups = run("mm_group", n, near.indptr, near.indices, group)
    return scipy.sparse.csr_matrix((np.ones(n), group, np.arange(n + 1)), (n, n_groups))


def _sweep(A: Any, x: Floats, right: Floats, *, backward: bool) -> None:
    """Solve each row for its own unknown, one after the other."""
    run("mm_sweep", len(x), A.indptr, A.indices, A.data, right, x, int(backward))


def _tentative(groups: Any, constant: Floats) -> tuple[Any, Floats]:
    """Interpolation that is constant on each group, of unit length; and the coarser constant."""
    T = scipy.sparse.csr_matrix(groups, dtype=np.float64)
    T.data = np.repeat(constant, np.diff(T.indptr))
    lengths = np.sqrt(np.asarray(T.multiply(T).sum(axis=0)).ravel())
    T.data /= lengths[T.indices]
    return T, lengths


def _radius(A: Any) -> float:
    """Largest eigenvalue of the matrix over its diagonal, by powers from a fixed beginning."""
    inverse = 1.0 / A.diagonal()
    x = np.random.default_rng(0).uniform(0.5, 1.5, A.shape[0])
    x *= np.where(np.arange(len(x)) % 2, 1.0, -1.0)
    value = 1.0
    for _ in range(_POWER_STEPS):
        x = inverse * (A @ x)
        value = float(np.linalg.norm(x))
        x /= value
    return value
