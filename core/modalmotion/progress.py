"""Progress of long work, and the milliseconds of its stages."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from operator import length_hint
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Progress:
    """How much of some work is done.

    Attributes
    ----------
    done : float
        Items, such as frames or bytes; with a total of 1 the share of the work.
    total : float
        Of all items, as far as known.
    stage : str
        What is done now; empty if the work has no stages.
    """

    done: float
    total: float = 1.0
    stage: str = ""

    @property
    def share(self) -> float:
        """Share that is done, 0 to 1."""
        return min(self.done / max(self.total, 1.0), 1.0)


Reporter = Callable[[Progress], None]
"""Called with the progress of some work, now and again."""


def silent(_: Progress) -> None:
    """Report nothing."""


def reported(items: Iterable[T], report: Reporter | None, total: int | None = None) -> Iterator[T]:
    """Yield items, and report each when the next one is asked for."""
    known = length_hint(items) if total is None else total
    for number, item in enumerate(items, start=1):
        yield item
        if report is not None:
            report(Progress(number, max(known, number)))


def part_of(report: Reporter, start: float, stop: float, stage: str = "") -> Reporter:
    """Report the progress of a part as that of the whole, by the name of a stage if it has one."""

    def inside(part: Progress) -> None:
        report(Progress(start + (stop - start) * part.share, stage=stage or part.stage))

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
        Part of the whole that each stage is counted as; together at most 1. Without them the
        progress of each stage is reported by itself.
    report : callable, optional
        Called when a stage begins, while it lasts, and without a name when it ends; with shares
        the share never falls.
    """

    def __init__(
        self, shares: Mapping[str, float] | None = None, report: Reporter = silent
    ) -> None:
        self.milliseconds: dict[str, float] = {}
        self._shares = None if shares is None else dict(shares)
        self._report = report
        self._done = 0.0

    @contextmanager
    def stage(self, name: str) -> Iterator[Reporter]:
        """Add the time of the block to a stage; gives the callback of the stage's own progress."""
        start = time.perf_counter()
        # One that comes again is counted once.
        share = 1.0 if self._shares is None else self._shares.pop(name, 0.0)
        end = self._done + share
        inside = part_of(self._report, self._done, end, name)
        inside(Progress(0.0))
        try:
            yield inside
        finally:
            spent = 1e3 * (time.perf_counter() - start)
            self.milliseconds[name] = self.milliseconds.get(name, 0.0) + spent
            self._done = 0.0 if self._shares is None else end
            self._report(Progress(self._done))
