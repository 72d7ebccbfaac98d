"""Shares of long work."""

from __future__ import annotations

import math

import pytest

from modalmotion.progress import as_share, in_percent, part_of, share_fallen


def test_a_part_is_told_as_its_share_of_the_whole() -> None:
    told: list[float] = []
    inside = part_of(part_of(told.append, 0.5, 1.0), 0.0, 0.5)
    for share in (0.0, 0.5, 1.0):
        inside(share)
    assert told == [0.5, 0.625, 0.75]


def test_items_are_reported_as_a_share_and_a_share_as_percent() -> None:
    steps: list[tuple[int, int]] = []
    second_half = as_share(part_of(in_percent(lambda *step: steps.append(step)), 0.5, 1.0))
    for done in range(3):
        second_half(done, 2)
    as_share(in_percent(lambda *step: steps.append(step)))(0, 0)
    assert steps == [(50, 100), (75, 100), (100, 100), (0, 100)]
    in_percent(None)(0.5)


def test_what_falls_by_equal_powers_goes_on_by_equal_shares() -> None:
    shares = [share_fallen(10.0**-k, 1.0, 1e-12) for k in range(13)]
    assert shares == pytest.approx([k / 12 for k in range(13)])
    assert share_fallen(0.0, 1.0, 1e-300) == 1.0
    # What rises, or is no number, has not come any nearer.
    for value in (2.0, math.inf, math.nan):
        assert share_fallen(value, 1.0, 1e-12) == 0.0
