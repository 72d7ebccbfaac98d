"""The 95th percentile, without sorting everything."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


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
