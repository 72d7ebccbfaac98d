"""Intervals of means over cases, some of which are of one subject."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Z = 1.959963984540054
"""97.5 % of a standard normal."""


def design_effect(residuals: NDArray[np.float64], subjects: Sequence[str]) -> float:
    """Factor by which a mean over cases varies more than one over independent cases.

    Parameters
    ----------
    residuals : (cases,) float64
        Of each case, what it adds to the mean beyond its share; they add up to 0.
    subjects : sequence of str
        Who each case is of. Cases of one subject are alike, so they count as fewer.

    Notes
    -----
    Kish, Survey sampling, 1965: variance of the mean between subjects over that of independent
    cases, never below 1.
    """
    n = len(residuals)
    _, place = np.unique(np.asarray(subjects), return_inverse=True)
    sizes = np.bincount(place)
    m = len(sizes)
    if m == n:
        return 1.0
    # All cases of a subject alike is the worst that can be.
    worst = float((sizes**2).sum() / n)
    independent = float((residuals**2).sum())
    if m == 1 or independent <= 0:
        return worst
    between = float((np.bincount(place, residuals) ** 2).sum()) * m / (m - 1)
    return min(max(1.0, between / independent), worst)


def share_interval(right: NDArray[np.generic], subjects: Sequence[str]) -> tuple[float, float]:
    """95 % interval of the share that is right, for subjects that have not been seen.

    Parameters
    ----------
    right : (cases,) bool, or float64 from 0 to 1
        At least one; of several answers to a case the share that is right.
    subjects : sequence of str
        As in `design_effect`.

    Returns
    -------
    (float, float)

    Notes
    -----
    Wilson, Probable inference, J Am Stat Assoc, 1927, on n / `design_effect` cases.
    """
    shares = np.asarray(right, dtype=np.float64)
    n, p = len(shares), float(shares.mean())
    n_effective = n / design_effect(shares - p, subjects)
    centre = (p + Z**2 / (2 * n_effective)) / (1 + Z**2 / n_effective)
    half = Z / (1 + Z**2 / n_effective)
    half *= np.sqrt(p * (1 - p) / n_effective + Z**2 / (4 * n_effective**2))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


def loss_interval(
    losses: NDArray[np.float64], subjects: Sequence[str], most: float = np.inf
) -> tuple[float, float] | None:
    """95 % interval of a mean of losses, none below 0; None for one case or one subject.

    Parameters
    ----------
    losses : (cases,) float64
    subjects : sequence of str
        As in `design_effect`.
    most : float
        That a loss can be.

    Notes
    -----
    Normal, with the variance of the mean times its `design_effect`.
    """
    n, mean = len(losses), float(losses.mean())
    if len(set(subjects)) < 2:
        return None
    residuals = losses - mean
    variance = float((residuals**2).sum()) / (n - 1) / n * design_effect(residuals, subjects)
    half = Z * np.sqrt(variance)
    return max(0.0, float(mean - half)), min(most, float(mean + half))
