"""Progress of long work, and the milliseconds of its stages."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

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


StageReport = Callable[[float, str], None]
"""Called with the share that is done, 0 to 1, and the name of the stage that is done now."""


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
        self,
        shares: Mapping[str, float] | None = None,
        report: StageReport = lambda _share, _name: None,
    ) -> None:
        self.milliseconds: dict[str, float] = {}
        self._shares = dict(shares or {})
        self._report = report
        self._done = 0.0
        self.of_stage = 0.0
        """Share that is done of the stage that is done now, where it says so."""

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
