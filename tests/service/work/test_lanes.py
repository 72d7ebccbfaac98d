"""Short work has a process of its own, owners take turns, and no work is without end."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import pytest
from worker_tasks import hang, note, slow_mark, wait_for

from modalmotion_service.work.engine import DISTRUST_SECONDS, SHORT_SECONDS, Lanes, Task, Terms
from modalmotion_service.work.pool import WorkerPool

MEMORY = 3_000_000_000
LONG = Terms("a", 100.0)
SHORT = Terms("b", 0.01)


@pytest.fixture
def pool() -> Iterator[WorkerPool]:
    with WorkerPool(1, 60.0, MEMORY, has_lane=True) as pool:
        yield pool
        pool.shutdown(cancel_futures=True)


def under_way(pool: WorkerPool, mark: Path, terms: Terms, seconds: float = 60.0) -> None:
    """Begin a task and wait until its process has it."""
    pool.submit_for(terms, slow_mark, mark, seconds)
    while not mark.exists():
        time.sleep(0.01)


def test_short_work_waits_for_no_long_work(pool: WorkerPool, tmp_path: Path) -> None:
    under_way(pool, tmp_path / "mark", LONG)
    waiting = [pool.submit_for(LONG, hang) for _ in range(20)]
    for terms in (SHORT, Terms("a", 0.01)):
        assert pool.submit_for(terms, abs, -3).result(timeout=20) == 3
    assert pool.n_waiting == {"short": 0, "long": 20}
    assert not any(future.running() or future.done() for future in waiting)


def test_the_lane_takes_no_long_work(pool: WorkerPool) -> None:
    waiting = [pool.submit_for(LONG, os.getpid) for _ in range(10)]
    assert len({future.result(timeout=20) for future in waiting}) == 1


def task(owner: str, price: float) -> Task:
    return Task(Future(), abs, bytes, 1, 1.0, Terms(owner, price))


def test_workers_do_short_work_when_nothing_long_waits() -> None:
    lanes = Lanes()
    tasks = [task("a", SHORT_SECONDS), task("a", 2 * SHORT_SECONDS), task("b", SHORT_SECONDS)]
    for one in tasks:
        assert lanes.put(one)
    assert lanes.lengths == {"short": 2, "long": 1}
    order = [lanes.take(is_lane=is_lane) for is_lane in (False, True, False)]
    assert order == [tasks[1], tasks[0], tasks[2]]
    assert lanes.close(give_up=False) == []
    assert not lanes.put(tasks[0])
    lanes.put_back(tasks[0])
    assert tasks[0].future.cancelled()
    assert lanes.take(is_lane=False) is None


def test_what_outlives_the_lane_is_done_in_the_long_queue(
    pool: WorkerPool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("modalmotion_service.work.pool.LANE_SECONDS", 0.2)
    under_way(pool, tmp_path / "mark", LONG, 1.0)
    # Dearer than it looks: the lane gives it up, and the worker does it when it is free.
    looks_short = pool.submit_for(SHORT, slow_mark, tmp_path / "other", 0.6)
    while not (tmp_path / "other").exists():
        time.sleep(0.01)
    behind = pool.submit_for(Terms("c", 0.01), abs, -1)
    assert behind.result(timeout=20) == 1
    assert not looks_short.done()
    # Its owner's next one is not believed to be short.
    next_one = pool.submit_for(SHORT, abs, -2)
    assert pool.submit_for(Terms("c", 0.01), abs, -1).result(timeout=20) == 1
    assert looks_short.result(timeout=20) == "done"
    assert next_one.result(timeout=20) == 2


def test_the_long_queue_of_an_owner_holds_up_nobody_else(tmp_path: Path) -> None:
    order, gate = tmp_path / "order", tmp_path / "gate"
    with WorkerPool(1, 60.0, MEMORY) as pool:
        # Nothing is taken before all wait, however busy the machine is.
        pool.submit_for(LONG, wait_for, gate)
        for number in range(48):
            pool.submit_for(LONG, note, order, f"a{number}")
        for number in range(2):
            pool.submit_for(Terms("b", 5.0), note, order, f"b{number}")
        gate.touch()
    assert sorted(map(order.read_text().split().index, ("a0", "b0", "b1"))) == [0, 1, 2]


def test_an_owner_is_believed_again_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr("modalmotion_service.work.engine.time.monotonic", lambda: now)

    lanes = Lanes()

    def lane_of(owner: str) -> str:
        for one in lanes.close(give_up=True):
            one.future.cancel()
        lanes._is_open = True
        assert lanes.put(task(owner, SHORT_SECONDS / 2))
        return next(name for name, length in lanes.lengths.items() if length)

    assert lane_of("a") == "short"
    lanes.put_back(task("a", SHORT_SECONDS / 2))
    assert (lane_of("a"), lane_of("b")) == ("long", "short")
    now = DISTRUST_SECONDS + 1.0
    assert lane_of("a") == "short"
