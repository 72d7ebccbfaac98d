"""Matrix products with the same bits on any number of threads.

Measured: docs/decisions/0002-bit-identical-products.md.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

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
    # The longer side lies along the rows in memory: long sums, or long vectors to add.
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
