"""Singular values of one small matrix, without the preparations of numpy's own.

These take three times as long as the decomposition itself, which is the same routine of LAPACK.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def singular_values(matrix: Array) -> Array:
    """Singular values of a matrix (m, n), (min(m, n),) float64, the largest first.

    Raises
    ------
    LinAlgError
        If they are not found, as where a value is not a number.
    """
    # Of the transpose they are the same, and its memory is in LAPACK's order.
    _, values, _, info = _dgesdd()(matrix.T, compute_uv=0)
    _require_found(info)
    return np.asarray(values)


def small_svd(matrix: Array) -> tuple[Array, Array, Array]:
    """U, s and V' with U diag(s) V' = a square matrix; see `singular_values`."""
    V, values, Ut, info = _dgesdd()(matrix.T)
    _require_found(info)
    return Ut.T, values, V.T


@cache
def _dgesdd() -> Any:
    # Not before it is used: a server starts without it.
    from scipy.linalg.lapack import dgesdd

    return dgesdd


def _require_found(info: int) -> None:
    if info:
        raise np.linalg.LinAlgError("the singular values were not found")
