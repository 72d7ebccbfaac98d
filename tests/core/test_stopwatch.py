"""Times by stage, and the share that is done by the stages that are."""

from __future__ import annotations

import contextlib
import time
from itertools import pairwise

import pytest

from modalmotion.progress import Progress, Stopwatch


def test_shares_never_fall_and_end_where_they_add_up() -> None:
    told: list[Progress] = []
    watch = Stopwatch({"read": 0.5, "fit": 0.4}, told.append)
    with watch.stage("read") as report:
        for done in (0.5, 1.0):
            report(Progress(done))
    # One that is not known counts nothing, and one that comes again counts once.
    for name in ("unknown", "fit", "fit"):
        with watch.stage(name):
            pass
    shares = [one.share for one in told]
    assert all(a <= b for a, b in pairwise(shares))
    assert [(one.share, one.stage) for one in told[:4]] == [
        (0.0, "read"),
        (0.25, "read"),
        (0.5, "read"),
        (0.5, ""),
    ]
    assert shares[-1] == pytest.approx(0.9)


def test_without_shares_each_stage_is_reported_by_itself() -> None:
    told: list[Progress] = []
    watch = Stopwatch(report=told.append)
    for name in ("read", "fit"):
        with watch.stage(name) as report:
            report(Progress(1, 4))
        assert told[-3:] == [Progress(0.0, stage=name), Progress(0.25, stage=name), Progress(0.0)]


def test_a_stage_that_fails_is_counted_and_stages_add_up() -> None:
    watch = Stopwatch()
    start = time.perf_counter()
    with contextlib.suppress(ValueError), watch.stage("a"):
        time.sleep(0.01)
        raise ValueError
    for _ in range(2):
        with watch.stage("b"):
            time.sleep(0.01)
    waited = 1e3 * (time.perf_counter() - start)
    assert 0.9 * waited < sum(watch.milliseconds.values()) <= waited
    assert list(watch.milliseconds) == ["a", "b"]
