"""Reliability: whether a probability is the share that is right."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

_N_BINS: Final = 10

# A bin of fewer says nothing of a share.
_LEAST_IN_BIN: Final = 5

Curve = tuple[tuple[float, float, int], ...]


def calibration_curve(
    confidence: NDArray[np.float64], right: NDArray[np.bool_], n_repetitions: int = 1
) -> Curve:
    """Mean probability of the label, share that was right and number of cases, by bins.

    Parameters
    ----------
    confidence : (cases,) float64
        Probability of the label.
    right : (cases,) bool
    n_repetitions : int
        How often each case is among them.

    Returns
    -------
    tuple of (float, float, int)
        One for each of ten bins of equal count, from the least sure to the surest; fewer where a
        bin would hold fewer than five cases.

    Notes
    -----
    Nguyen and O'Connor, Posterior calibration and exploratory analysis for natural language
    processing models, EMNLP, 2015. Bins of equal width leave most of them nearly empty where
    most answers are sure.
    """
    order = np.argsort(confidence, kind="stable")
    n_bins = min(_N_BINS, max(1, len(order) // (_LEAST_IN_BIN * n_repetitions)))
    return tuple(
        (round(float(confidence[b].mean()), 6), round(float(right[b].mean()), 6), len(b))
        for b in np.array_split(order, n_bins)
        if len(b)
    )


def calibration_error(curve: Curve) -> float:
    """Give the expected calibration error of a curve: its mean distance from the diagonal.

    Naeini, Cooper and Hauskrecht, Obtaining well calibrated probabilities using Bayesian
    binning, AAAI, 2015.
    """
    n = sum(count for _, _, count in curve)
    return sum(abs(mean - share) * count for mean, share, count in curve) / max(n, 1)
