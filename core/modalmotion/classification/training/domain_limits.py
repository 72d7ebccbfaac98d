"""Limits of a domain: beyond what all but a few of the held-out cases are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def domain_limit(held_out: NDArray[np.float64], known_share: float) -> float:
    """Score that a share of new cases stays within.

    Parameters
    ----------
    held_out : (cases,) float64
        Scores of cases for a domain that they did not take part in, independent of one another.
    known_share : float

    Notes
    -----
    The k-th of n is exceeded by a new one with probability 1 - k / (n + 1). Where the farthest
    is exceeded too often, the scores are taken to thin out beyond it exponentially: of n such
    ones the largest is expected at b (1 + 1/2 + ... + 1/n), and the median at b log 2.
    """
    n = len(held_out)
    rank = int(np.ceil(known_share * (n + 1) - 1e-9))
    ordered = np.sort(held_out)
    if rank <= n:
        return float(ordered[rank - 1])
    b = (ordered[-1] - np.median(ordered)) / ((1.0 / np.arange(1, n + 1)).sum() - np.log(2.0))
    return float(ordered[-1] - b * np.log((n + 1) * (1.0 - known_share)))


def joint_limits(
    held_out: NDArray[np.float64], known_share: float, groups: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Limits of several scores that a share of new cases stays within all together.

    Each has its own limit; then all are raised by one number of their standard deviations.

    Parameters
    ----------
    held_out : (cases, checks) float64
    known_share : float
    groups : (cases,) int64
        Of each only the highest score counts, for its cases are not independent.

    Returns
    -------
    (checks,) float64
        Infinite for a score that is the same in all cases.
    """
    own = _highest(held_out, groups)
    limits = np.array([domain_limit(scores, known_share) for scores in own.T])
    widths = held_out.std(axis=0)
    varies = widths > 1e-9 * np.abs(held_out).max(axis=0, initial=0.0)
    limits[~varies] = np.inf
    if varies.any():
        beyond = ((own - limits)[:, varies] / widths[varies]).max(axis=1)
        limits[varies] += max(0.0, domain_limit(beyond, known_share)) * widths[varies]
    return limits


def _highest(held_out: NDArray[np.float64], groups: NDArray[np.int64]) -> NDArray[np.float64]:
    """Give the highest scores of each group, (groups, checks)."""
    _, place = np.unique(groups, return_inverse=True)
    highest = np.full((int(place.max()) + 1, held_out.shape[1]), -np.inf)
    np.maximum.at(highest, place, held_out)
    return highest
