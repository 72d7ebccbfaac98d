"""Lowest eigenpairs of sparse symmetric matrices, the same from any solver.

Where eigenvalues coincide a solver returns any basis of their space. Here each such space gets
the basis that fixed probe vectors, projected into it one after the other, span: it depends on
the space alone. That also fixes the sign of every vector.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.errors import LimitError, ModeCountError

MOST_EQUAL: Final = 100
"""Eigenvalues that may coincide: a surface has a handful, a heap of equal pieces as many as it has
pieces, and the space of each is found whole."""

# Below this size the dense solver is faster and finds every multiple eigenvalue.
_DENSE: Final = 600

# Above this one it takes minutes and gigabytes.
_LARGEST_DENSE: Final = 5000

# Eigenvalues closer than this, relative to them and to the largest possible, are one.
_SAME: Final = 1e-8
_ZERO: Final = 1e-11

# Extra pairs, so that a space that ends beyond the requested ones is seen whole.
_GUARD: Final = 8

# A probe whose projection is this much shorter than expected tells nothing.
_FAINT: Final = 1e-3


def lowest_eigenpairs(
    matrix: scipy.sparse.csc_array, n_pairs: int, first_probes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest eigenvalues and eigenvectors of a positive semidefinite matrix.

    Parameters
    ----------
    matrix : (n, n) scipy.sparse.csc_array of float64
    n_pairs : int
    first_probes : (n, k) float64
        Probe vectors tried before the fixed irregular ones.

    Returns
    -------
    eigenvalues : (n_pairs,) float64
        In increasing order.
    vectors : (n, n_pairs) float64
        Orthonormal.

    Raises
    ------
    ModeCountError
        If `n_pairs` exceeds n, or the solver loses some.
    LimitError
        If more than `MOST_EQUAL` eigenvalues coincide.
    """
    n = matrix.shape[0]
    if not 1 <= n_pairs <= n:
        raise ModeCountError(
            f"{n_pairs} modes were requested; there are {n}.",
            remedy=f"Ask for 1 to {n} modes.",
            details={"modes": n_pairs, "most": n},
        )
    scale = float(np.abs(matrix).sum(axis=0).max())
    count = n_pairs
    while True:
        values, vectors = _solve(matrix, min(n, count + _GUARD), scale)
        groups = _groups(values, scale)
        if any(g.stop - g.start > MOST_EQUAL for g in groups if g.start < n_pairs):
            raise _too_many_equal()
        # The last group may go on beyond these pairs, unless they are all.
        complete = groups if len(values) == n else groups[:-1]
        if complete and complete[-1].stop >= n_pairs:
            break
        count *= 2
    spaces = [group for group in complete if group.start < n_pairs]
    basis = [_canonical(vectors[:, group], first_probes) for group in spaces]
    return values[:n_pairs], np.concatenate(basis, axis=1)[:, :n_pairs]


def _solve(
    matrix: scipy.sparse.csc_array, count: int, scale: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    n = matrix.shape[0]
    if n <= _DENSE or count > n // 3:
        values, vectors = scipy.linalg.eigh(matrix.toarray())
        return values[:count], vectors[:, :count]
    shift = -1e-4 * scale * 600 / n
    for attempt in range(3):
        # More room on each attempt: a larger subspace meets more copies.
        room = min(n, (attempt + 2) * count + 20)
        try:
            values, vectors = scipy.sparse.linalg.eigsh(
                matrix, k=count, sigma=shift, ncv=room, v0=_irregular(n, attempt), tol=0
            )
        except scipy.sparse.linalg.ArpackError as error:
            raise _too_many_equal() from error
        order = np.argsort(values, kind="stable")
        values, vectors = values[order], vectors[:, order]
        groups = _groups(values, scale)
        if len(groups) < 2:
            return values, vectors
        # Krylov methods may miss copies of a multiple eigenvalue; the signs of the pivots
        # tell how many there are below a gap (Sylvester's law of inertia).
        last = groups[-1].start
        between = (values[last - 1] + values[last]) / 2
        if _n_below(matrix, between) == last:
            return values, vectors
        count = min(n - 1, count + _GUARD)
    if n > _LARGEST_DENSE:
        raise ModeCountError(
            f"The lowest {count} spring modes of {n} vertices could not all be solved for: too "
            "many frequencies coincide.",
            remedy="Ask for fewer modes, or state a topology.",
            details={"modes": count},
        )
    values, vectors = scipy.linalg.eigh(matrix.toarray())
    return values[:count], vectors[:, :count]


def _too_many_equal() -> LimitError:
    return LimitError(
        f"More than {MOST_EQUAL} modes of the mesh have the same frequency: it is made of many "
        "equal parts.",
        remedy="Send one surface, without the parts that repeat.",
        limit="equal_frequencies",
        details={"most": MOST_EQUAL},
    )


def _n_below(matrix: scipy.sparse.csc_array, value: float) -> int:
    shifted = scipy.sparse.csc_array(
        matrix - value * scipy.sparse.diags_array(np.ones(matrix.shape[0]), format="csc")
    )
    factors = scipy.sparse.linalg.splu(
        shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return int((factors.U.diagonal() < 0).sum())


def _groups(values: NDArray[np.float64], scale: float) -> list[slice]:
    """Find runs of eigenvalues that coincide."""
    gaps = np.diff(values) > _SAME * np.abs(values[1:]) + _ZERO * scale
    starts = [0, *(np.flatnonzero(gaps) + 1).tolist()]
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(values)], strict=True)]


def _canonical(
    space: NDArray[np.float64], first_probes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Give a space the basis that the probes span in it, one after the other."""
    n, k = space.shape
    vectors: list[NDArray[np.float64]] = []
    expected = np.sqrt(k / n)
    for index in range(first_probes.shape[1] + 50 * k):
        if index < first_probes.shape[1]:
            probe = first_probes[:, index]
        else:
            probe = _irregular(n, index - first_probes.shape[1])
        # Coordinates within the space: the projection is space @ inside.
        inside = space.T @ (probe / np.linalg.norm(probe))
        for _ in range(2):
            for before in vectors:
                inside = inside - (before @ inside) * before
        length = float(np.linalg.norm(inside))
        if length > _FAINT * expected:
            vectors.append(inside / length)
            if len(vectors) == k:
                break
    basis: NDArray[np.float64] = space @ np.stack(vectors, axis=1)
    return basis


def _irregular(n: int, index: int) -> NDArray[np.float64]:
    """Return a fixed vector without pattern: fractional parts of multiples of a square root."""
    step = np.sqrt(_prime(index + 1))
    vector: NDArray[np.float64] = np.modf(np.arange(1, n + 1) ** 2 * (step % 1.0))[0] - 0.5
    return vector


@lru_cache(maxsize=10_000)
def _prime(index: int) -> int:
    candidate, count = 1, 0
    while count < index:
        candidate += 1
        count += all(candidate % d for d in range(2, int(candidate**0.5) + 1))
    return candidate
