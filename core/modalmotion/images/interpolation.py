"""Values between the samples of an image: linear, without those that are missing."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

# Of the eight or four samples around a place, by weight: fewer that are there say too little.
_LEAST_SHARE = 0.5


def interpolated(
    values: NDArray[Any], indices: NDArray[np.float64], missing: NDArray[np.bool_] | None
) -> NDArray[np.float64]:
    """Interpolate linearly; NaN outside, and where most samples around are missing.

    Parameters
    ----------
    values : (i, j, k) or (i, j) array
        Zero where missing.
    indices : (n, axes) float64
    missing : array of bool like `values`, or None for none

    Returns
    -------
    (n,) float64
    """
    places = np.ascontiguousarray(indices.T)
    found: NDArray[np.float64] = map_coordinates(
        values, places, output=np.float64, order=1, cval=np.nan
    )
    if missing is not None:
        there: NDArray[np.float64] = map_coordinates(
            1.0 - missing, places, output=np.float64, order=1, cval=np.nan
        )
        with np.errstate(invalid="ignore"):
            found = np.where(there >= _LEAST_SHARE, found / np.maximum(there, _LEAST_SHARE), np.nan)
    return found
