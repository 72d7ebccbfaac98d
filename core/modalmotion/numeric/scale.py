"""Scales at which squares neither overflow nor vanish."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


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
