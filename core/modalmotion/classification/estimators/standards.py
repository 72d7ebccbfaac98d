"""Centre and scale of features."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def standards(X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation of each column; infinite where it is constant to rounding."""
    centre, spread = X.mean(axis=0), X.std(axis=0)
    return centre, np.where(spread > 1e-12 * np.abs(X).max(axis=0), spread, np.inf)


def class_means(
    z: NDArray[np.float64], y: NDArray[np.int64], n_classes: int
) -> NDArray[np.float64]:
    """Mean of the cases of each class, (classes, features) float64; 0 of a class without any."""
    is_member = (y == np.arange(n_classes)[:, None]).astype(np.float64)
    means: NDArray[np.float64] = is_member @ z / np.maximum(is_member.sum(axis=1), 1.0)[:, None]
    return means
