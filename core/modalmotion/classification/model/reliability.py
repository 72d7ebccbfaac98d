"""Reliability: whether a probability is the share that is right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_N_BINS = 10

Curve = tuple[tuple[float, float, int], ...]


def calibration_curve(confidence: NDArray[np.float64], right: NDArray[np.bool_]) -> Curve:
    """Mean probability of the label, share that was right and number of cases, by bins.

    Parameters
    ----------
    confidence : (cases,) float64
        Probability of the label.
    right : (cases,) bool

    Returns
    -------
    tuple of (float, float, int)
        One for each of ten equal bins that holds a case.
    """
    bins = np.minimum((confidence * _N_BINS).astype(np.int64), _N_BINS - 1)
    return tuple(
        (
            round(float(confidence[bins == b].mean()), 6),
            round(float(right[bins == b].mean()), 6),
            int((bins == b).sum()),
        )
        for b in range(_N_BINS)
        if (bins == b).any()
    )


def calibration_error(curve: Curve) -> float:
    """Give the expected calibration error of a curve: its mean distance from the diagonal.

    Naeini, Cooper and Hauskrecht, Obtaining well calibrated probabilities using Bayesian
    binning, AAAI, 2015.
    """
    n = sum(count for _, _, count in curve)
    return sum(abs(mean - share) * count for mean, share, count in curve) / max(n, 1)
