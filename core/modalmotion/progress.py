"""Progress of long work, as functions that it calls meanwhile."""

from __future__ import annotations

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
