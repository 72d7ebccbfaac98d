"""Limits of a domain: beyond what all but a few of the held-out cases are."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# With too few cases for the requested share, the farthest one and this share more is the limit.
_MARGIN: Final = 0.5


def domain_limit(held_out: NDArray[np.float64], known_share: float, origin: float = 0.0) -> float:
    """Score that a share of new cases stays within.

    Parameters
    ----------
    held_out : (cases,) float64
        Scores of cases for a domain that they did not take part in.
    known_share : float
    origin : float
        Score of a case that is not strange at all.
    """
    n = len(held_out)
    # The k-th of n is exceeded by a new one with probability 1 - k / (n + 1).
    rank = int(np.ceil(known_share * (n + 1) - 1e-9))
    ordered = np.sort(held_out)
    if rank <= n:
        return float(ordered[rank - 1])
    return float(ordered[-1] + _MARGIN * (ordered[-1] - origin))


def joint_limits(
    held_out: NDArray[np.float64], known_share: float, are_distances: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Limits of several scores that a share of new cases stays within all together.

    Each has its own limit; then all are raised by one number of their standard deviations.

    Parameters
    ----------
    held_out : (cases, checks) float64
    known_share : float
    are_distances : (checks,) bool
        Distances count from 0, others from their median.

    Returns
    -------
    (checks,) float64
        Infinite for a score that is the same in all cases.
    """
    origins = np.where(are_distances, 0.0, np.median(held_out, axis=0))
    limits = np.array(
        [
            domain_limit(scores, known_share, origin)
            for scores, origin in zip(held_out.T, origins, strict=True)
        ]
    )
    widths = held_out.std(axis=0)
    varies = widths > 1e-9 * np.abs(held_out).max(axis=0, initial=0.0)
    limits[~varies] = np.inf
    if varies.any():
        beyond = ((held_out - limits)[:, varies] / widths[varies]).max(axis=1)
        more = domain_limit(beyond, known_share, float(np.median(beyond)))
        limits[varies] += max(0.0, more) * widths[varies]
    return limits
