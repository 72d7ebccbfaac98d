"""QR decompositions of tall matrices, the same on any number of threads."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.products import product

# Rows factored at once. Small enough for one thread, so that the bits are always the same.
_ROWS: Final = 1024

# Rows of a triangle that are eliminated one by one.
_TRIANGLE: Final = 64


# Condition up to which one division by R leaves columns orthogonal to 13 digits.
_WELL: Final = 1e3


def tall_qr(A: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """QR of a matrix of full rank with many more rows than columns.

    Parameters
    ----------
    A : (rows, columns) float64

    Returns
    -------
    Q : (rows, columns) float64
    R : (columns, columns) float64
        Its diagonal is positive.
    """
    R = triangle_of(A)
    return orthonormal(A, R, float(np.linalg.cond(R)))


def triangle_of(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """R of a matrix with many more rows than columns, block by block.

    Each block of rows is factored by itself, then their triangles together (Demmel, Grigori,
    Hoemmen and Langou, Communication-optimal parallel and sequential QR and LU factorizations,
    SIAM Journal on Scientific Computing, 2012). As stable as one factorisation, faster for it
    stays in the cache, and its bits do not depend on the number of threads.

    Parameters
    ----------
    A : (rows, columns) float64

    Returns
    -------
    (columns, columns) float64
        Its diagonal is not negative.
    """
    step = max(_ROWS, 2 * A.shape[1])
    while len(A) >= 2 * step:
        parts = np.split(A, range(step, len(A) - step + 1, step))
        A = np.concatenate([_r(part) for part in parts])
    R = _r(A)
    signed: NDArray[np.float64] = R * np.where(np.diag(R) < 0, -1.0, 1.0)[:, None]
    return signed


def _r(A: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.qr(A, mode="r"))


def orthonormal(
    A: NDArray[np.float64], R: NDArray[np.float64], condition: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Q and R of a matrix whose R and condition are known, twice as fast as by reflections.

    Q = A R^-1 is orthogonal to the condition's share of the precision: where that is not enough Q
    is factored once more, which makes it so to the last digits.
    """
    Q = product(A, inverse_of_triangle(R))
    if condition > _WELL:
        again = triangle_of(Q)
        Q, R = product(Q, inverse_of_triangle(again)), product(again, R)
    return Q, R


def inverse_of_triangle(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert an upper triangle by substitution, with the same bits on any number of threads.

    Parameters
    ----------
    R : (n, n) float64
        Upper triangular, without a zero on its diagonal.

    Returns
    -------
    (n, n) float64
    """
    n = len(R)
    inverse = np.zeros((n, n))
    for start in range((n - 1) // _TRIANGLE * _TRIANGLE, -1, -_TRIANGLE):
        rows = slice(start, start + _TRIANGLE)
        stop = min(start + _TRIANGLE, n)
        right = np.zeros((stop - start, n))
        right[:, start:stop] = np.eye(stop - start)
        right[:, stop:] -= product(R[rows, stop:], inverse[stop:, stop:])
        for i in range(stop - 1, start - 1, -1):
            known = product(R[i : i + 1, i + 1 : stop], inverse[i + 1 : stop])
            inverse[i] = (right[i - start] - known[0]) / R[i, i]
    return inverse
