"""How much is done, told while it is being done."""

from __future__ import annotations

from modalmotion.progress import ShareReport


def silent(_: float) -> None:
    """Tell nobody."""


def part_of(report: ShareReport, start: float, stop: float) -> ShareReport:
    """Tell the share of a part as that of the whole."""

    def inside(share: float) -> None:
        report(start + (stop - start) * share)

    return inside
