"""The 95th percentile, without sorting everything."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# Of so many values one is looked at first, in rows of so many values at least.
_STEP: Final = 8
_LEAST: Final = 512


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
    if n >= _LEAST:
        # Of the upper values alone; a sample says where a tenth of them begins.
        sample = values[:, ::_STEP]
        tenth = sample.shape[1] - 1 - sample.shape[1] // 10
        is_high = values >= np.partition(sample, tenth, axis=1)[:, tenth, None]
        counts = is_high.sum(axis=1)
        if (counts >= n - place).all():
            return _among(values[is_high], counts, n - place)
    result: NDArray[np.float64] = np.partition(values, place, axis=1)[:, place]
    return result


def _among(high: NDArray[np.float64], counts: NDArray[np.int64], k: int) -> NDArray[np.float64]:
    """k-th largest of each of some runs of values, which are reordered."""
    result, ends = np.empty(len(counts)), np.cumsum(counts)
    for row, (count, end) in enumerate(zip(counts.tolist(), ends.tolist(), strict=True)):
        run = high[end - count : end]
        run.partition(count - k)
        result[row] = run[count - k]
    return result
