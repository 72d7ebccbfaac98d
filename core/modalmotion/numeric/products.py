"""Tall products and sums whose bits do not depend on the number of threads.

A threaded BLAS cuts large products where the number of threads dictates, and rounds otherwise for
each cut. OpenBLAS leaves small ones to one thread, so larger ones are cut here, always in the
same places: docs/decisions/0002-bit-identical-products.md. Sums use NumPy's pairwise addition.

`transform.products` does the same for stacks of lattice factors, which are small and many; here
they are few, and thousands of rows long.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Multiplications up to which OpenBLAS, old or new, uses one thread; for a product with a
# vector, elements of the matrix.
LARGEST_SINGLE_THREADED: Final = 2**18
LARGEST_WITH_VECTOR: Final = 8192


def product(
    A: NDArray[np.float64], B: NDArray[np.float64], out: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Matrix product A B in tiles.

    Parameters
    ----------
    A : (m, k) float64
    B : (k, n) float64
    out : (m, n) float64, optional
        Overwritten.

    Returns
    -------
    (m, n) float64
    """
    m, n, k = A.shape[0], B.shape[1], A.shape[1]
    if out is None:
        out = np.empty((m, n))
    rows, columns, depth = tile(m, n, k)
    for i in range(0, m, rows):
        for j in range(0, n, columns):
            part = out[i : i + rows, j : j + columns]
            for p in range(0, k, depth):
                a, b = A[i : i + rows, p : p + depth], B[p : p + depth, j : j + columns]
                if p == 0:
                    np.matmul(a, b, out=part)
                else:
                    part += a @ b
    if k == 0:
        out[...] = 0.0
    return out


@lru_cache(maxsize=256)
def tile(m: int, n: int, k: int) -> tuple[int, int, int]:
    """Rows, columns and depth of the tiles of an m x n product of depth k.

    The longest side is cut into ever more equal pieces until one thread does a tile. No side is
    cut while another is longer, so that a left-over of one row or column is a small product with
    a vector.
    """
    pieces, sides = [1, 1, 1], [max(m, 1), max(n, 1), max(k, 1)]
    size = list(sides)
    largest = LARGEST_WITH_VECTOR if min(m, n) == 1 else LARGEST_SINGLE_THREADED
    while size[0] * size[1] * size[2] > largest:
        longest = size.index(max(size))
        pieces[longest] += 1 if pieces[longest] < 8 else pieces[longest] // 4
        size[longest] = -(-sides[longest] // pieces[longest])
    return size[0], size[1], size[2]


def weighted_sum(weights: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of values times weights over the first axis.

    Parameters
    ----------
    weights : (n,) float64
    values : (n, d) float64

    Returns
    -------
    (d,) float64
    """
    return np.array([(weights * column).sum() for column in values.T])


def second_moments(
    weights: NDArray[np.float64], left: NDArray[np.float64], right: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Sum of weights times products of coordinates, sum w l r', (d, e) float64.

    Parameters
    ----------
    weights : (n,) float64
    left : (n, d) float64
    right : (n, e) float64
    """
    return np.stack([weighted_sum(weights * column, right) for column in left.T])


def along(vectors: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Component of each vector in a direction, (n,) float64.

    Parameters
    ----------
    vectors : (n, 3) float64
    direction : (3,) float64
    """
    x, y, z = vectors.T
    total: NDArray[np.float64] = x * direction[0] + y * direction[1] + z * direction[2]
    return total
