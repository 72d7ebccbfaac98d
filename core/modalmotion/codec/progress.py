"""How much is done, told while it is being done."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]


def silent(_: float) -> None:
    """Tell nobody."""


def part_of(report: Progress, start: float, stop: float) -> Progress:
    """Tell the share of a part as that of the whole."""

    def inside(share: float) -> None:
        report(start + (stop - start) * share)

    return inside
