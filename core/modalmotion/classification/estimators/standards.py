"""Centre and scale of features."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def standards(X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation of each column; infinite where it is constant to rounding."""
    centre, spread = X.mean(axis=0), X.std(axis=0)
    return centre, np.where(spread > 1e-12 * np.abs(X).max(axis=0), spread, np.inf)
