"""Progress of long work, as functions that it calls meanwhile."""

from __future__ import annotations

import math
from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called with the number of items done and of all items."""

ShareReport = Callable[[float], None]
"""Called with the share that is done, 0 to 1."""


def silent(_: float) -> None:
    """Report nothing."""


def part_of(report: ShareReport, start: float, stop: float) -> ShareReport:
    """Report the share of a part as that of the whole."""

    def inside(share: float) -> None:
        report(start + (stop - start) * share)

    return inside


def share_fallen(value: float, start: float, end: float) -> float:
    """Tell how far a value has come from its start to its end, counting its powers.

    Parameters
    ----------
    value : float
    start, end : float
        More than 0, the end less.

    Returns
    -------
    float
        0 to 1.
    """
    if value <= end:
        return 1.0
    if not value < start:
        return 0.0
    return (math.log(start) - math.log(value)) / (math.log(start) - math.log(end))
