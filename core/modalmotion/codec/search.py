"""Search for the coarsest step within the target error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.blocking import ModalBlock, attempt
from modalmotion.codec.temporal import Temporal
from modalmotion.codec.trial import PRICE, Trial

Floats = NDArray[np.float64]

CLOSE_ENOUGH: Final = 0.996
MOST_ATTEMPTS: Final = 12


def coarsest(
    motion: ModalBlock, kind: Temporal, squared_error: float, start: float, price: float = PRICE
) -> Trial | None:
    """Find the coarsest step whose squared error stays within a bound.

    Parameters
    ----------
    motion : ModalBlock
    kind : Temporal
    squared_error : float, quanta squared
        Summed over frames and vertices.
    start : float, quanta
        Step to try first.
    price : float, squared steps per bit

    Returns
    -------
    Trial or None
        None if the finest step tried is still too coarse.
    """
    best: Trial | None = None
    low, high = -np.inf, np.inf
    log_step, slope = np.log(start), 1.6
    goal, boldness = np.log(squared_error), 0.01
    for _ in range(MOST_ATTEMPTS):
        trial = attempt(motion, kind, float(np.exp(log_step)), price)
        if trial is None:
            break
        error = np.log(max(trial.squared_error, 1e-300))
        if error <= goal:
            if best is None or trial.quantiser.step > best.quantiser.step:
                best = trial
            low = max(low, log_step)
            if error >= goal + 2 * np.log(CLOSE_ENOUGH) or trial.quantiser.step > 1e30:
                break
        else:
            high = min(high, log_step)
        if high - low < 1e-3:
            break
        # Aim a little below the goal, boldly where the error stays level, within the bracket.
        change = np.clip((goal - 0.004 - error) / slope, -4.0, 4.0)
        if not np.isfinite(low):
            boldness *= 2.0
            change = min(change, -boldness)
        target = log_step + change
        if not low < target < high:
            target = (low + high) / 2
        if np.isfinite(low) and np.isfinite(high):
            width = high - low
            target = min(max(target, low + 0.02 * width), high - 0.02 * width)
        log_step = target
    return best


def least(cost: Callable[[float], int], start: float, ratio: float, most: int) -> float:
    """Walk from a start in steps of a ratio to where the cost is least, then look between steps.

    Parameters
    ----------
    cost : callable
        Keeps what it was asked: the last one, between two steps, may be the least of all.
    start : float
    ratio : float
    most : int
        Costs that are asked for.

    Returns
    -------
    float
        The best argument of those a whole number of steps from the start.
    """
    tried = {0: cost(start)}
    best = 0
    for direction in (1, -1):
        while len(tried) < most and best + direction not in tried:
            tried[best + direction] = cost(start * ratio ** (best + direction))
            if tried[best + direction] >= tried[best]:
                break
            best += direction
    if len(tried) < most and {best - 1, best + 1} <= tried.keys():
        low, middle, high = (tried[best + side] for side in (-1, 0, 1))
        if low + high > 2 * middle:
            # Where a parabola through the three is least, which is between them.
            cost(start * ratio ** (best + 0.5 * (low - high) / (low + high - 2 * middle)))
    return float(start * ratio**best)
