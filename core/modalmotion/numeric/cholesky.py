"""Positive definite systems, the same bits on any number of threads."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.products import product

# Rows of a diagonal block. Small enough for one thread.
_ROWS: Final = 48


def inverse_of_cholesky(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse L^-1 of the lower triangle L with L L' = A, block by block.

    Parameters
    ----------
    A : (n, n) float64
        Symmetric and positive definite; its lower half is read.

    Returns
    -------
    (n, n) float64
        Lower triangular. A^-1 b is `inverse.T @ (inverse @ b)`.

    Raises
    ------
    numpy.linalg.LinAlgError
        If A is not positive definite.
    """
    n = len(A)
    L, inverse = np.tril(A), np.zeros((n, n))
    for start in range(0, n, _ROWS):
        rows, stop = slice(start, start + _ROWS), min(start + _ROWS, n)
        eye = np.eye(stop - start)
        triangle = np.linalg.cholesky(L[rows, rows])
        own = np.linalg.solve(triangle, eye)
        inverse[rows, rows] = np.tril(own)
        if start:
            left = product(np.ascontiguousarray(L[rows, :start]), inverse[:start, :start])
            inverse[rows, :start] = -product(own, left)
        L[rows, rows] = triangle
        if stop < n:
            below = product(np.ascontiguousarray(L[stop:, rows]), np.ascontiguousarray(own.T))
            L[stop:, rows] = below
            L[stop:, stop:] -= product(below, np.ascontiguousarray(below.T))
    return inverse


def gram(inverse: NDArray[np.float64]) -> NDArray[np.float64]:
    """A^-1 of L^-1, exactly symmetric.

    Parameters
    ----------
    inverse : (n, n) float64
        As `inverse_of_cholesky` returns it.
    """
    full = product(np.ascontiguousarray(inverse.T), inverse)
    symmetric: NDArray[np.float64] = (full + full.T) / 2
    return symmetric
