from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, wait
from pathlib import Path

import pytest
from worker_tasks import die, die_once, hang, refuse, swallow_memory

from modalmotion.errors import LimitError, NonFiniteError
from modalmotion_service.errors import WorkerDiedError
from modalmotion_service.executor import WorkerPool


@pytest.fixture(scope="module")
def pool() -> Iterator[WorkerPool]:
    with WorkerPool(n_workers=2, task_seconds=2.0, memory_bytes=3_000_000_000) as pool:
        yield pool


def test_it_is_an_executor_and_gives_results(pool: WorkerPool) -> None:
    assert isinstance(pool, Executor)
    assert list(pool.map(abs, [-1, 2, -3])) == [1, 2, 3]
    assert pool.submit(os.getpid).result() != os.getpid()


def test_our_errors_cross_with_everything_they_say(pool: WorkerPool) -> None:
    with pytest.raises(NonFiniteError) as caught:
        pool.submit(refuse).result()
    error = caught.value
    assert (error.frame, error.vertex, error.remedy) == (3, 4, "advice")
    assert error.details == {"count": 1}


def test_a_task_that_hangs_is_ended_and_others_go_on(pool: WorkerPool) -> None:
    stuck = pool.submit(hang)
    assert pool.submit(abs, -1).result(timeout=10) == 1
    with pytest.raises(LimitError) as caught:
        stuck.result(timeout=20)
    assert caught.value.limit == "task_seconds"


def test_a_task_that_swallows_memory_is_refused(pool: WorkerPool) -> None:
    with pytest.raises(LimitError) as caught:
        pool.submit(swallow_memory).result(timeout=20)
    assert caught.value.limit == "task_memory_bytes"
    assert pool.submit(abs, -1).result(timeout=10) == 1


def test_a_killed_worker_costs_no_result(pool: WorkerPool, tmp_path: Path) -> None:
    assert pool.submit(die_once, tmp_path / "mark").result(timeout=20) == "done"


def test_a_task_that_kills_every_worker_fails_alone(pool: WorkerPool) -> None:
    others = [pool.submit(abs, -n) for n in range(20)]
    with pytest.raises(WorkerDiedError):
        pool.submit(die).result(timeout=20)
    wait(others, timeout=20)
    assert [other.result() for other in others] == list(range(20))


def test_a_worker_killed_while_it_is_idle_costs_nothing() -> None:
    with WorkerPool(n_workers=2, task_seconds=20.0, memory_bytes=3_000_000_000) as pool:
        for _ in range(5):
            pids = [pool.submit(os.getpid) for _ in range(2)]
            for pid in {future.result(timeout=20) for future in pids}:
                os.kill(pid, signal.SIGKILL)
            started = time.monotonic()
            assert list(pool.map(abs, [-1, -2, -3])) == [1, 2, 3]
            assert time.monotonic() - started < 20


def test_waiting_tasks_are_finished_or_cancelled_at_shutdown() -> None:
    pool = WorkerPool(n_workers=1, task_seconds=20.0, memory_bytes=3_000_000_000)
    futures = [pool.submit(abs, -n) for n in range(10)]
    pool.shutdown(wait=True)
    assert [future.result() for future in futures] == list(range(10))
    with pytest.raises(RuntimeError):
        pool.submit(abs, -1)
    pool = WorkerPool(n_workers=1, task_seconds=20.0, memory_bytes=3_000_000_000)
    stuck = [pool.submit(hang) for _ in range(3)]
    pool.shutdown(wait=True, cancel_futures=True)
    assert stuck[-1].cancelled()


def test_cancelling_ends_the_work() -> None:
    with WorkerPool(n_workers=1, task_seconds=60.0, memory_bytes=3_000_000_000) as single:
        stuck = single.submit(hang)
        threading.Event().wait(0.3)
        assert stuck.cancel()
        with pytest.raises(CancelledError):
            stuck.result(timeout=1)
        assert single.submit(abs, -5).result(timeout=20) == 5
