"""Values between the samples of an image: linear, without those that are missing."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

# Of the eight or four samples around a place, by weight: fewer that are there say too little.
_LEAST_SHARE = 0.5


def interpolated(
    values: NDArray[Any], indices: NDArray[np.float64], *, are_missing: bool
) -> NDArray[np.float64]:
    """Interpolate linearly; NaN outside, and where most samples around are missing.

    Parameters
    ----------
    values : (i, j, k) or (i, j) array
        NaN where missing.
    indices : (n, axes) float64
    are_missing : bool
        Whether any are.

    Returns
    -------
    (n,) float64
    """
    if are_missing:
        return _among_missing(values, indices)
    places = np.ascontiguousarray(indices.T)
    found: NDArray[np.float64] = scipy.ndimage.map_coordinates(
        values, places, output=np.float64, order=1, cval=np.nan
    )
    return found


def _among_missing(values: NDArray[Any], indices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weigh the samples around each place that are there; no array as large as the image."""
    last = np.array(values.shape) - 1
    with np.errstate(invalid="ignore"):
        inside = ((indices >= 0) & (indices <= last)).all(axis=1)
    places = indices[inside]
    low = np.minimum(places.astype(np.int64), np.maximum(last - 1, 0))
    share = places - low
    total, weight = np.zeros(len(places)), np.zeros(len(places))
    for corner in product((0, 1), repeat=len(last)):
        step = np.array(corner)
        own = np.where(step, share, 1.0 - share).prod(axis=1)
        samples = values[tuple(np.minimum(low + step, last).T)].astype(np.float64)
        is_there = np.isfinite(samples)
        total += np.where(is_there, own * np.where(is_there, samples, 0.0), 0.0)
        weight += np.where(is_there, own, 0.0)
    found = np.full(len(indices), np.nan)
    enough = weight >= _LEAST_SHARE
    found[inside] = np.where(enough, total / np.maximum(weight, _LEAST_SHARE), np.nan)
    return found
