"""Weighted quantiles without sorting everything."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# Sorted besides those that would be enough if all weights were equal.
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
    The largest values are picked without sorting the others, half as many again as would do
    if all weighed the same. Where those weigh too little after all, the whole row is sorted.
    """
    allowed = (1.0 - q) * float(weights.sum())
    n = values.shape[1]
    rank = max(0, n - 2 - int((1.0 + _MARGIN) * (1.0 - q) * n))
    bounds = np.partition(values, rank, axis=1)[:, rank]
    result = np.empty(len(values))
    for k, (row, bound) in enumerate(zip(values, bounds, strict=True)):
        chosen = np.flatnonzero(row > bound)
        found = _from_top(row[chosen], weights[chosen], allowed)
        if found is None:
            found = _from_top(row, weights, allowed)
        result[k] = row.min() if found is None else found
    return result


def _from_top(
    values: NDArray[np.float64], weights: NDArray[np.float64], allowed: float
) -> float | None:
    """Value at which the weight above it first exceeds what is allowed; None if it never does."""
    order = np.argsort(values)[::-1]
    reached = np.cumsum(weights[order])
    # The weight above a value is what the larger ones have; ties count together.
    index = int(np.searchsorted(reached, allowed, side="right"))
    return float(values[order[index]]) if index < len(order) else None
