"""Search for the error at which a stream just fits into a size."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

MOST_TRIALS: Final = 14
# Of the size that is allowed: where to aim, and what is close enough.
AIM: Final = 0.995
FULL_ENOUGH: Final = 0.99
# Ratios of errors, as logarithms, that are worth no more trials: between two streams, and between a
# stream and what is too fine for one.
CLOSE: Final = 0.01
COARSE: Final = 0.1
LONGEST_STEP: Final = 6.0


def try_sizes(
    size: Callable[[float], int | None],
    most: int,
    bracket: tuple[float, float],
    start: float,
    slope: float,
) -> None:
    """Try errors until one has nearly the largest size that is allowed.

    At fine errors the size falls straight with the logarithm of the error: a bit for each
    coefficient where the error is halved. Lines through the nearest two trials find it.

    Parameters
    ----------
    size : callable
        Bytes at the logarithm of an error; None where it is too fine for a stream. Whoever asks
        keeps the best.
    most : int
        Bytes.
    bracket : (float, float)
        Logarithms of the least and of the largest error.
    start : float
        Logarithm of the first.
    slope : float
        Bytes that an error e times smaller costs at most.
    """
    low, high = bracket
    tried: dict[float, int] = {}
    log_error = start
    for _ in range(MOST_TRIALS):
        n_bytes = size(log_error)
        width = high - low
        if n_bytes is not None:
            tried[log_error] = n_bytes
        if n_bytes is None or n_bytes > most:
            low = log_error
        else:
            high = log_error
            if n_bytes > FULL_ENOUGH * most:
                return
        if high - low < (CLOSE if low in tried else COARSE):
            return
        is_slow = low in tried and high in tried and high - low > width / 2
        guess = None if is_slow else _straight(tried, AIM * most, slope)
        log_error = guess if guess is not None and low < guess < high else (low + high) / 2


def _straight(tried: dict[float, int], goal: float, slope: float) -> float | None:
    """Where the line through the nearest two, or of a slope through the only one, has a size."""
    nearest = sorted(tried, key=lambda at: abs(tried[at] - goal))[:2]
    if not nearest:
        return None
    if len(nearest) == 2:
        one, other = nearest
        slope = -(tried[other] - tried[one]) / (other - one)
    if slope <= 0:
        return None
    change = (tried[nearest[0]] - goal) / slope
    return nearest[0] + min(max(change, -LONGEST_STEP), LONGEST_STEP)
