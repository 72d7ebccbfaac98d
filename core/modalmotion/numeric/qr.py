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


def tall_qr(A: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """QR of a matrix with many more rows than columns, block by block.

    Each block of rows is factored by itself, then their triangles together (Demmel, Grigori,
    Hoemmen and Langou, Communication-optimal parallel and sequential QR and LU factorizations,
    SIAM Journal on Scientific Computing, 2012). As stable as one factorisation, faster for it
    stays in the cache, and its bits do not depend on the number of threads.

    Parameters
    ----------
    A : (rows, columns) float64

    Returns
    -------
    Q : (rows, columns) float64
    R : (columns, columns) float64
        Its diagonal is not negative.
    """
    n, m = A.shape
    step = max(_ROWS, 2 * m)
    starts = list(range(0, max(n - step, 0) + 1, step))
    ends = [*starts[1:], n]
    factors = [np.linalg.qr(A[i:j]) for i, j in zip(starts, ends, strict=True)]
    Q = np.empty((n, m))
    if len(factors) == 1:
        Q[...], R = factors[0]
    else:
        joint, R = tall_qr(np.concatenate([triangle for _, triangle in factors]))
        for k, (i, j) in enumerate(zip(starts, ends, strict=True)):
            product(factors[k][0], joint[k * m : (k + 1) * m], out=Q[i:j])
    sign = np.where(np.diag(R) < 0, -1.0, 1.0)
    return Q * sign, R * sign[:, None]


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
