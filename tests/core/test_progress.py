"""Shares of long work."""

from __future__ import annotations

import math

import pytest

from modalmotion.progress import Progress, part_of, reported, share_fallen


def test_a_part_is_told_as_its_share_of_the_whole() -> None:
    told: list[Progress] = []
    inside = part_of(part_of(told.append, 0.5, 1.0), 0.0, 0.5, "fit")
    for done in range(3):
        inside(Progress(done, 2))
    assert told == [Progress(share, stage="fit") for share in (0.5, 0.625, 0.75)]
    part_of(told.append, 0.0, 1.0)(Progress(0, 0, "no items"))
    assert told[-1] == Progress(0.0, stage="no items")
    # There may be more items than were expected: no more than all is done.
    assert Progress(5, 4).share == 1.0


def test_items_are_reported_once_they_are_done() -> None:
    seen: list[Progress] = []
    for number, item in enumerate(reported("abc", seen.append)):
        assert item == "abc"[number]
        assert len(seen) == number
    assert seen == [Progress(k, 3) for k in (1, 2, 3)]
    seen.clear()
    # How many there are is told, or comes to be known.
    assert list(reported(iter("abc"), None)) == list(reported((c for c in "abc"), seen.append))
    assert seen == [Progress(k, k) for k in (1, 2, 3)]
    seen.clear()
    list(reported((c for c in "ab"), seen.append, 4))
    assert seen == [Progress(1, 4), Progress(2, 4)]


def test_what_falls_by_equal_powers_goes_on_by_equal_shares() -> None:
    shares = [share_fallen(10.0**-k, 1.0, 1e-12) for k in range(13)]
    assert shares == pytest.approx([k / 12 for k in range(13)])
    assert share_fallen(0.0, 1.0, 1e-300) == 1.0
    # What rises, or is no number, has not come any nearer.
    for value in (2.0, math.inf, math.nan):
        assert share_fallen(value, 1.0, 1e-12) == 0.0
