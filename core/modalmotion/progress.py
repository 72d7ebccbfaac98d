"""Progress of long work, and the milliseconds of its stages."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Concatenate, ParamSpec

Progress = Callable[[int, int], None]
"""Called with the number of items done and of all items, as far as known.

Where stages differ in length, the items are percent of the work.
"""

ShareReport = Callable[[float], None]
"""Called with the share that is done, 0 to 1."""


StageReport = Callable[[float, str], None]
"""Called with the share that is done, 0 to 1, and the name of the current stage."""

P = ParamSpec("P")


def silent(*_: object) -> None:
    """Report nothing."""


def in_percent(progress: Progress | None) -> ShareReport:
    """Report a share as percent done of 100."""
    return silent if progress is None else lambda share: progress(round(100 * share), 100)


def as_share(report: ShareReport) -> Progress:
    """Report the number of items done as their share."""
    return lambda done, total: report(done / max(total, 1))


def part_of(
    report: Callable[Concatenate[float, P], None], start: float, stop: float
) -> Callable[Concatenate[float, P], None]:
    """Report the share of a part as that of the whole."""

    def inside(share: float, /, *stage: P.args, **named: P.kwargs) -> None:
        report(start + (stop - start) * share, *stage, **named)

    return inside


def share_fallen(value: float, start: float, end: float) -> float:
    """Measure how far a value has come from its start to its end, counting its powers.

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


class Stopwatch:
    """Adds up the milliseconds that named stages take, and reports which one has begun.

    Parameters
    ----------
    shares : mapping of str to float, optional
        Part of the whole that each stage is counted as; together at most 1.
    report : callable, optional
        Called when a stage begins, and without a name when it ends; the share never falls.
    """

    def __init__(
        self, shares: Mapping[str, float] | None = None, report: StageReport = silent
    ) -> None:
        self.milliseconds: dict[str, float] = {}
        self._shares = dict(shares or {})
        self._report = report
        self._done = 0.0
        self.of_stage = 0.0
        """Share of the current stage that is done, if the stage reports it."""

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        """Add the time of the block to a stage; gives a function that reports its own share."""
        start = time.perf_counter()
        # One that comes again is counted once.
        begun, share = self._done, self._shares.pop(name, 0.0)

        def tell(inside: float) -> None:
            self.of_stage = inside
            self._report(begun + share * inside, name)

        self.of_stage = 0.0
        self._report(begun, name)
        try:
            yield tell
        finally:
            spent = 1e3 * (time.perf_counter() - start)
            self.milliseconds[name] = self.milliseconds.get(name, 0.0) + spent
            self._done = begun + share
            self._report(self._done, "")
