from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, wait
from pathlib import Path
from typing import Any

import pytest
from project import ROOT
from worker_tasks import (
    die,
    die_once,
    hang,
    is_running,
    note,
    refuse,
    short,
    spin,
    swallow_memory,
)

from modalmotion.errors import LimitError, NonFiniteError
from modalmotion_service.errors import ClusterError, CostError, WorkerDiedError
from modalmotion_service.http.problems import problem_body
from modalmotion_service.work.engine import Engine, Terms
from modalmotion_service.work.forks import FORKS
from modalmotion_service.work.pool import MOST_STARTS, WorkerPool

MEMORY = 3_000_000_000
OpenEngine = Callable[[float], Engine]


@pytest.fixture(scope="module")
def open_engine() -> OpenEngine:
    return lambda task_seconds: WorkerPool(2, task_seconds, MEMORY)


@pytest.fixture(scope="module")
def pool(open_engine: OpenEngine) -> Iterator[Engine]:
    with open_engine(2.0) as pool:
        yield pool


def test_it_is_an_executor_and_gives_results(pool: Engine) -> None:
    assert isinstance(pool, Executor)
    assert pool.n_workers == 2
    assert list(pool.map(abs, [-1, 2, -3])) == [1, 2, 3]
    pool.require_ready()
    assert pool.submit(os.getpid).result() != os.getpid()


def test_whoever_hands_a_task_on_does_not_wait_until_it_is_written(pool: Engine) -> None:
    gate = threading.Event()

    class Many:
        def __reduce__(self) -> tuple[type[int], tuple[int]]:
            assert gate.wait(20)
            return int, (-3,)

    many: Any = Many()
    futures = [pool.submit(abs, many) for _ in range(2)]
    assert futures[1].cancel()
    gate.set()
    assert futures[0].result(timeout=20) == 3
    assert pool.submit(abs, -1).result(timeout=20) == 1


def test_our_errors_cross_with_everything_they_say(pool: Engine) -> None:
    with pytest.raises(NonFiniteError) as caught:
        pool.submit(refuse).result()
    error = caught.value
    assert (error.frame, error.vertex, error.remedy) == (3, 4, "advice")
    assert error.details == {"count": 1}


def test_a_task_that_hangs_is_ended_and_others_go_on(pool: Engine) -> None:
    stuck = pool.submit(hang)
    assert pool.submit(abs, -1).result(timeout=10) == 1
    with pytest.raises(LimitError) as caught:
        stuck.result(timeout=20)
    assert caught.value.limit == "task_seconds"


def test_a_task_that_swallows_memory_is_refused(pool: Engine) -> None:
    with pytest.raises(LimitError) as caught:
        pool.submit(swallow_memory).result(timeout=20)
    assert caught.value.limit == "task_memory_bytes"
    assert pool.submit(abs, -1).result(timeout=10) == 1


def test_a_task_that_takes_more_than_its_means_is_ended_by_name(open_engine: OpenEngine) -> None:
    # Seconds of a clock are many on a machine with others.
    with open_engine(60.0) as pool:
        honest = pool.submit_for(Terms("b", 0.1, 60.0), abs, -1)
        costly = pool.submit_for(Terms("a", 0.01, 0.3), spin)
        # Whoever waits takes nothing of it.
        idle = pool.submit_for(Terms("a", 1.0, 0.3), short, 5, 0.5)
        with pytest.raises(CostError, match="processor time") as caught:
            costly.result(timeout=60)
        assert caught.value.limit == "task_cost_factor"
        assert caught.value.remedy
        assert problem_body(caught.value)["status"] == 422
        assert (honest.result(timeout=60), idle.result(timeout=60)) == (1, 5)


def test_owners_take_turns(open_engine: OpenEngine, tmp_path: Path) -> None:
    order = tmp_path / "order"
    with open_engine(20.0) as pool:
        many = [pool.submit_for(Terms("a", 1.0), note, order, "a", 0.1) for _ in range(20)]
        one = pool.submit_for(Terms("b", 1.0), note, order, "b", 0.1)
        one.result(timeout=60)
        # Not one of the two workers has begun more than one more of the other's.
        assert sum(future.done() for future in many) < 8
        pool.shutdown(cancel_futures=True)


def test_a_killed_worker_costs_no_result(pool: Engine, tmp_path: Path) -> None:
    assert pool.submit(die_once, tmp_path / "mark").result(timeout=20) == "done"


def test_a_task_that_kills_every_worker_fails_alone(pool: Engine) -> None:
    others = [pool.submit(abs, -n) for n in range(20)]
    with pytest.raises(WorkerDiedError):
        pool.submit(die).result(timeout=20)
    wait(others, timeout=20)
    assert [other.result() for other in others] == list(range(20))


def test_a_worker_killed_while_it_is_idle_costs_nothing(open_engine: OpenEngine) -> None:
    with open_engine(20.0) as pool:
        for _ in range(2):
            pids = [pool.submit(os.getpid) for _ in range(2)]
            for pid in {future.result(timeout=20) for future in pids}:
                os.kill(pid, signal.SIGKILL)
            started = time.monotonic()
            assert list(pool.map(abs, [-1, -2, -3])) == [1, 2, 3]
            assert time.monotonic() - started < 20


def test_a_machine_that_starts_no_process_is_told_and_may_recover(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    n_tries = 0

    def refuse_to_start(*_: object) -> None:
        nonlocal n_tries
        n_tries += 1
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    with monkeypatch.context() as broken:
        broken.setattr(FORKS, "fork", refuse_to_start)
        pool = WorkerPool(1, 20.0, MEMORY)
        waiting = [pool.submit(abs, -n) for n in range(3)]
        for future in waiting:
            with pytest.raises(ClusterError, match="No process could be started") as caught:
                future.result(timeout=20)
            assert caught.value.remedy
        assert 3 <= n_tries <= 3 * MOST_STARTS + 1
    assert pool.submit(abs, -4).result(timeout=20) == 4
    pool.shutdown()


def test_waiting_tasks_are_finished_or_cancelled_at_shutdown(open_engine: OpenEngine) -> None:
    pool = open_engine(20.0)
    futures = [pool.submit(abs, -n) for n in range(10)]
    pool.shutdown(wait=True)
    assert [future.result() for future in futures] == list(range(10))
    with pytest.raises(RuntimeError):
        pool.submit(abs, -1)
    pool = open_engine(20.0)
    stuck = [pool.submit(hang) for _ in range(3)]
    pool.shutdown(wait=True, cancel_futures=True)
    assert stuck[-1].cancelled()


def test_cancelling_ends_the_work(open_engine: OpenEngine) -> None:
    with open_engine(20.0) as pool:
        stuck = [pool.submit(hang) for _ in range(2)]
        threading.Event().wait(0.2)
        for future in stuck:
            assert future.cancel()
            with pytest.raises(CancelledError):
                future.result(timeout=1)
        # Both places are free again, long before what hung there would have ended.
        assert list(pool.map(abs, [-5, -6, -7], timeout=15)) == [5, 6, 7]


@pytest.mark.thorough
def test_a_worker_ends_with_the_process_that_it_works_for(tmp_path: Path) -> None:
    code = (
        "import os, signal\n"
        "from modalmotion_service.work.pool import WorkerPool\n"
        "from worker_tasks import hang\n"
        "if __name__ == '__main__':\n"
        "    pool = WorkerPool(1, 60.0, 3_000_000_000)\n"
        "    print(pool.submit(os.getpid).result(), flush=True)\n"
        "    pool.submit(hang)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    script = tmp_path / "killed.py"
    script.write_text(code)
    path = [str(ROOT / "tests" / "support"), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path)}
    run = subprocess.run(
        [sys.executable, script], env=environment, capture_output=True, check=False
    )
    worker = int(run.stdout)
    for _ in range(200):
        if not is_running(worker):
            return
        time.sleep(0.05)
    raise AssertionError("the worker goes on")
