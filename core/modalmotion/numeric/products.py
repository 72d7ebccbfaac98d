"""Products and factorisations whose bits do not depend on the number of threads, at any scale.

A threaded BLAS cuts large products where the number of threads dictates, and rounds otherwise for
each cut. OpenBLAS leaves small ones to one thread, so larger ones are cut here, always in the
same places: docs/decisions/0002-bit-identical-products.md. Sums use NumPy's pairwise addition.

`transform.products` does the same for stacks of lattice factors, which are small and many; here
they are few, and thousands of rows long.

Measured: docs/decisions/0002-bit-identical-products.md.
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


# OpenBLAS shares a matrix-vector product among threads from 9,216 elements of the matrix on
# and a matrix product from 262,144 multiplications on, and then sums in another order.
_TILE: Final = 8192
_WORK: Final = 1 << 17

# Up to so many rows one product with a vector each is faster than one with the matrix.
_FEW_ROWS: Final = 7

# Up to so many columns they are better one vector; directions are three.
_FEW_COLUMNS: Final = 3

# Narrower pieces of a row waste what a processor fetches.
_NARROWEST: Final = 64


def multiply(
    matrix: NDArray[np.float64],
    stack: NDArray[np.float64],
    out: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Multiply each matrix of a stack from the left by the same matrix.

    Cut into tiles that no BLAS call shares among threads and added up in a fixed order that
    depends on the shapes alone. One matrix's product does not depend on the rest of the stack.

    Parameters
    ----------
    matrix : (m, k) float64
    stack : (stack, k, n) float64
    out : (stack, m, n) float64, optional
        C-contiguous, as `stack`.

    Returns
    -------
    (stack, m, n) float64
    """
    (m, k), n = matrix.shape, stack.shape[2]
    if out is None:
        out = np.empty((len(stack), m, n))
    if k == 1:
        return np.multiply(matrix, stack, out=out)
    if n <= _FEW_COLUMNS and m * k * n * n <= _TILE:
        _multiply_flat(matrix, stack, out)
        return out
    if k * n <= _TILE and (m <= _FEW_ROWS or (m * k <= _TILE and m * k * n <= _WORK)):
        _multiply_tile(matrix, stack, out)
        return out
    width = _even_piece(n, max(_NARROWEST, _TILE // k))
    depth = _even_piece(k, max(1, _TILE // width))
    height = m if m <= _FEW_ROWS else _even_piece(m, max(1, min(_WORK // width, _TILE) // depth))
    for left in range(0, n, width):
        columns = slice(left, left + width)
        for top in range(0, m, height):
            rows = slice(top, top + height)
            piece = out[:, rows, columns]
            _multiply_tile(matrix[rows, :depth], stack[:, :depth, columns], piece)
            for start in range(depth, k, depth):
                inner = slice(start, start + depth)
                more = np.empty(piece.shape)
                _multiply_tile(matrix[rows, inner], stack[:, inner, columns], more)
                piece += more
    return out


def _multiply_tile(
    matrix: NDArray[np.float64], stack: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    if len(matrix) <= _FEW_ROWS:
        np.matmul(matrix[:, None, :], stack[:, None], out=out[:, :, None, :])
    else:
        np.matmul(matrix, stack, out=out)


def _multiply_flat(
    matrix: NDArray[np.float64], stack: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """Multiply each member of the stack, written as one vector, by the matrix for each column.

    One product with a vector of 9 or 300 is faster than three with vectors of 3.
    """
    (m, k), n = matrix.shape, stack.shape[2]
    # The longer side is along the rows in memory: long sums, or long vectors to add.
    each = np.zeros((m, n, k, n) if k > m else (k, n, m, n))
    for column in range(n):
        each[:, column, :, column] = matrix if k > m else matrix.T
    flat = each.reshape(m * n, k * n).T if k > m else each.reshape(k * n, m * n)
    rows = stack.reshape(len(stack), 1, k * n)
    np.matmul(rows, flat, out=out.reshape(len(stack), 1, m * n))


def _even_piece(length: int, most: int) -> int:
    """Length of the pieces when as few as possible, none longer than `most`, share evenly."""
    n_pieces = max(1, -(-length // most))
    return max(1, -(-length // n_pieces))


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


# Rows of a diagonal block. Small enough for one thread.
_ROWS_OF_GRAM: Final = 48


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
    for start in range(0, n, _ROWS_OF_GRAM):
        rows, stop = slice(start, start + _ROWS_OF_GRAM), min(start + _ROWS_OF_GRAM, n)
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


def power_of_two(size: float) -> float:
    """Give a power of two just above a size: dividing by it is exact, and squares do not overflow.

    Parameters
    ----------
    size : float
        0 or more.

    Returns
    -------
    float
        Between 2^-1000 and 2^1000; 1 for 0.
    """
    return 1.0 if size == 0.0 else float(2.0 ** np.clip(np.frexp(size)[1], -1000, 1000))


def lengths(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lengths of vectors, none too large or too small to be squared.

    Parameters
    ----------
    vectors : (..., 1 or 3) float64

    Returns
    -------
    (...) float64
    """
    if vectors.shape[-1] == 1:
        return np.abs(vectors[..., 0])
    result: NDArray[np.float64] = np.hypot(
        np.hypot(vectors[..., 0], vectors[..., 1]), vectors[..., 2]
    )
    return result


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Root mean square without overflow of the squares."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    shares = values / largest
    shares *= shares
    return largest * float(np.sqrt(np.add.reduce(shares, axis=None) / shares.size))


def exceeded_by_a_twentieth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smallest value in each row that at most a twentieth of the row exceeds.

    Parameters
    ----------
    values : (rows, n) float64

    Returns
    -------
    (rows,) float64
    """
    n = values.shape[1]
    place = n - 1 - n // 20
    result: NDArray[np.float64] = np.partition(values, place, axis=1)[:, place]
    return result
