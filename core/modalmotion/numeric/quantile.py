"""Weighted quantiles without sorting everything."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# Sorted besides the number that equal weights would need.
_MARGIN: Final = 0.5


def weighted_quantile(
    values: NDArray[np.float64], weights: NDArray[np.float64], q: float
) -> NDArray[np.float64]:
    """Smallest value in each row above which lies at most a share 1 - q of the weight.

    Parameters
    ----------
    values : (rows, n) float64
    weights : (n,) float64
        Not negative, with a positive sum.
    q : float
        Between 0 and 1.

    Returns
    -------
    (rows,) float64

    Notes
    -----
    The largest values are picked without sorting the others, half as many again as equal
    weights would need. Where those weigh too little, the whole row is sorted.
    """
    allowed = (1.0 - q) * float(weights.sum())
    n = values.shape[1]
    n_largest = min(n, 1 + int((1.0 + _MARGIN) * (1.0 - q) * n))
    largest = np.argpartition(values, n - n_largest, axis=1)[:, n - n_largest :]
    result, is_found = _from_top(
        np.take_along_axis(values, largest, axis=1), weights[largest], allowed
    )
    for k in np.flatnonzero(~is_found):
        value, whole = _from_top(values[k : k + 1], weights[None], allowed)
        result[k] = value[0] if whole[0] else values[k].min()
    return result


def _from_top(
    values: NDArray[np.float64], weights: NDArray[np.float64], allowed: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Value of each row at which the weight from the top first exceeds the allowed weight.

    Also whether it does at all. Among equal values the choice is arbitrary.
    """
    order = np.argsort(values, axis=1)[:, ::-1]
    reached = np.cumsum(np.take_along_axis(weights, order, axis=1), axis=1)
    index = (reached <= allowed).sum(axis=1)
    is_found = index < values.shape[1]
    rows = np.arange(len(values))
    at = order[rows, np.minimum(index, values.shape[1] - 1)]
    return values[rows, at], is_found
