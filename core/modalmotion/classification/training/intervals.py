"""Intervals of a share that was counted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_Z = 1.959963984540054  # 97.5 % of a standard normal


def accuracy_interval(right: NDArray[np.bool_], subjects: Sequence[str]) -> tuple[float, float]:
    """95 % interval of the share that is right, for subjects that have not been seen.

    Parameters
    ----------
    right : (cases,) bool
        At least one.
    subjects : sequence of str
        Who each case is of. Cases of one subject are alike, so they count as fewer.

    Returns
    -------
    (float, float)

    Notes
    -----
    Wilson, Probable inference, J Am Stat Assoc, 1927, on n / deff cases; deff is the design
    effect of Kish, Survey sampling, 1965: variance of the share between subjects over that of
    independent cases, never below 1.
    """
    n, p = len(right), float(right.mean())
    _, place = np.unique(np.asarray(subjects), return_inverse=True)
    sizes = np.bincount(place)
    m = len(sizes)
    effect = 1.0
    if m < n:
        # All cases of a subject alike is the worst that can be.
        effect = float((sizes**2).sum() / n)
        independent = p * (1 - p) / n
        if m > 1 and independent > 0:
            residuals = np.bincount(place, right - p)
            between = float((residuals**2).sum()) / n**2 * m / (m - 1)
            effect = min(max(1.0, between / independent), effect)
    n_effective = n / effect
    centre = (p + _Z**2 / (2 * n_effective)) / (1 + _Z**2 / n_effective)
    half = _Z / (1 + _Z**2 / n_effective)
    half *= np.sqrt(p * (1 - p) / n_effective + _Z**2 / (4 * n_effective**2))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))
