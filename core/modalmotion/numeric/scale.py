"""Sizes of numbers that neither overflow nor vanish."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def lengths(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lengths of vectors, none too large or too small to be squared.

    Parameters
    ----------
    vectors : (..., 3) float64

    Returns
    -------
    (...) float64
    """
    found: NDArray[np.float64] = np.hypot(
        np.hypot(vectors[..., 0], vectors[..., 1]), vectors[..., 2]
    )
    return found


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Root mean square without overflow of the squares."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    return largest * float(np.sqrt(((values / largest) ** 2).mean()))
