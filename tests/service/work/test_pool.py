"""Whatever is killed at whatever moment, every future settles."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import threading
import time
from collections import Counter
from concurrent.futures import Future, wait
from pathlib import Path
from typing import Any

import pytest
from busy_machine import busy_processes
from worker_tasks import answer_twice, hang, is_running, short, slow_mark

from modalmotion.errors import LimitError
from modalmotion_service.errors import ClusterError, NoWorkerError, WorkerDiedError
from modalmotion_service.work.engine import Task
from modalmotion_service.work.forks import FORKS, WorkerProcess, is_stopped
from modalmotion_service.work.pool import Keeper, WorkerPool
from modalmotion_service.work.worker import answer as send_answer

MEMORY = 3_000_000_000
N_WORKERS = 3
# Of one task; a future that has not settled in a few times of it never will.
TASK_SECONDS = 5.0


def victims(pool: WorkerPool, what: str) -> list[int]:
    """Give the numbers of the processes that may be killed."""
    if what == "fork server":
        return [FORKS.pid]
    processes = [keeper._process for keeper in pool._keepers]
    return [process.pid for process in processes if process is not None]


def kill(pids: list[int], how: signal.Signals) -> None:
    for pid in pids:
        if pid > 0:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, how)


def kill_and_count(n_kills: int, seed: int) -> Counter[str]:
    """Kill at random moments, before, between and after tasks; count how the tasks ended."""
    rng = random.Random(seed)  # noqa: S311 (which process is killed is no secret)
    ends: Counter[str] = Counter()
    pool = WorkerPool(N_WORKERS, TASK_SECONDS, MEMORY)
    futures: list[Future[Any]] = []
    for n in range(n_kills):
        if rng.random() < 0.5:
            # All at rest: what is killed now is idle.
            wait(futures, timeout=20 * TASK_SECONDS)
        what = rng.choices(["all workers", "a worker", "fork server"], [4, 4, 1])[0]
        pids = victims(pool, what)
        if what == "a worker":
            pids = [rng.choice(pids)] if pids else []
        kill(pids, signal.SIGKILL)
        time.sleep(rng.uniform(0, 0.02))
        futures += [pool.submit(short, n, rng.uniform(0, 0.02)) for _ in range(3)]
        if len(futures) > 60:
            count(futures[:-10], ends)
            del futures[:-10]
    count(futures, ends)
    pool.shutdown()
    return ends


def count(futures: list[Future[Any]], ends: Counter[str]) -> None:
    wait(futures, timeout=20 * TASK_SECONDS)
    for future in futures:
        if not future.done():
            ends["unsettled"] += 1
        elif isinstance(error := future.exception(), (ClusterError, WorkerDiedError, LimitError)):
            ends["failed by name"] += 1
        elif error is not None:
            ends[f"failed: {error!r}"] += 1
        else:
            ends["done"] += 1


def test_a_few_kills_leave_no_future_unsettled() -> None:
    # By this seed of all workers, of one and of the fork server, at rest and at work.
    ends = kill_and_count(4, seed=9)
    assert ends.keys() <= {"done", "failed by name"}, ends
    assert ends["done"] > 8


@pytest.mark.soak
@pytest.mark.alone
def test_three_thousand_kills_on_a_busy_machine_leave_no_future_unsettled(
    capsys: pytest.CaptureFixture[str],
) -> None:
    n_kills = 3000 * int(os.environ.get("SOAK", "1"))
    with busy_processes(12):
        ends = kill_and_count(n_kills, seed=2)
    with capsys.disabled():
        print(f"\n{n_kills} kills: {dict(ends)}")  # noqa: T201
    assert ends.keys() <= {"done", "failed by name"}, ends
    assert ends["done"] > 8 * n_kills / 3


def test_a_task_that_hangs_ends_at_its_deadline() -> None:
    with WorkerPool(1, 1.0, MEMORY) as pool:
        assert pool.submit(abs, -1).result(timeout=60) == 1
        with pytest.raises(LimitError):
            pool.submit(hang).result(timeout=60)
        assert pool.submit(abs, -3).result(timeout=60) == 3


def test_workers_live_on_without_their_fork_server() -> None:
    with WorkerPool(1, 20.0, MEMORY) as pool:
        pid = pool.submit(os.getpid).result(timeout=60)
        kill(victims(pool, "fork server"), signal.SIGKILL)
        assert pool.submit(os.getpid).result(timeout=60) == pid


def is_ready(pool: WorkerPool) -> bool:
    with contextlib.suppress(NoWorkerError):
        pool.require_ready()
        return True
    return False


def test_it_is_ready_while_a_worker_answers_or_is_at_work() -> None:
    with WorkerPool(1, 20.0, MEMORY) as pool:
        assert pool.submit(abs, -1).result(timeout=60) == 1
        assert is_ready(pool)
        slow, behind = pool.submit(short, 1, 0.5), pool.submit(short, 2, 0.0)
        while not slow.done():
            assert is_ready(pool)
        assert behind.result(timeout=60) == 2


def test_stopped_workers_are_not_ready_and_are_replaced() -> None:
    n_workers = 2
    with WorkerPool(n_workers, 300.0, MEMORY) as pool:
        wait([pool.submit(short, n, 0.1) for n in range(2 * n_workers)], timeout=60)
        stopped = victims(pool, "workers")
        assert len(stopped) == n_workers
        kill([*stopped, *victims(pool, "fork server")], signal.SIGSTOP)
        while not all(map(is_stopped, stopped)):
            time.sleep(0.01)
        assert not is_ready(pool)
        for _ in range(30):
            if is_ready(pool):
                break
        assert is_ready(pool)
        assert pool.submit(abs, -1).result(timeout=60) == 1
        assert not any(map(is_running, stopped))


def test_one_worker_that_answers_is_enough() -> None:
    with WorkerPool(2, 300.0, MEMORY) as pool:
        wait([pool.submit(short, n, 0.2) for n in range(4)], timeout=60)
        kill(victims(pool, "workers")[:1], signal.SIGSTOP)
        assert is_ready(pool)


def test_a_task_of_a_stopped_worker_is_done_by_another_one(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    with WorkerPool(1, 300.0, MEMORY) as pool:
        task = pool.submit(slow_mark, mark, 0.2)
        while not mark.exists():
            time.sleep(0.01)
        kill(victims(pool, "workers"), signal.SIGSTOP)
        assert task.result(timeout=60) == "done"


def test_a_process_that_says_more_than_it_is_asked_is_not_believed() -> None:
    ours, theirs = socket.socketpair()
    process = WorkerProcess.__new__(WorkerProcess)
    process._socket, process.pid = ours, 0
    ours.setblocking(False)
    with ours, theirs:
        for answer in (b"", b"one", bytes(300_000)):
            assert process.is_idle
            sender = threading.Thread(target=send_answer, args=(theirs, answer))
            sender.start()
            assert process.exchange(b"", 5.0) == answer
            sender.join()
        # What it adds would be taken for the answer to the next question.
        send_answer(theirs, b"two")
        assert not process.is_idle
        assert process.is_alive


def test_a_worker_that_adds_to_its_answer_is_replaced() -> None:
    with WorkerPool(1, 20.0, MEMORY) as pool:
        pid = pool.submit(os.getpid).result(timeout=60)
        assert pool.submit(answer_twice).result(timeout=60) == 2
        assert pool.submit(os.getpid).result(timeout=60) not in (pid, 3)


def test_a_task_is_given_up_at_the_moment_at_which_its_process_is_replaced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with WorkerPool(1, 20.0, MEMORY) as pool:
        assert pool.submit(os.getpid).result(timeout=60) > 0
        (keeper,) = pool._keepers
        process = keeper._process
        assert process is not None
        looks = iter([process])
        replaced = property(lambda _: next(looks, None))
        monkeypatch.setattr(Keeper, "_process", replaced, raising=False)
        task = keeper._task = Task(Future(), hang, bytes, 1, 1.0)
        keeper._give_up(task)
        monkeypatch.undo()
        keeper._task = None
        assert pool.submit(os.getpid).result(timeout=60) != process.pid


def test_a_task_that_is_given_up_while_its_process_begins_is_not_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = WorkerProcess.__init__

    def given_up(process: WorkerProcess, *args: Any, **options: Any) -> None:
        begin(process, *args, **options)
        keeper = threading.current_thread()
        assert isinstance(keeper, Keeper)
        assert keeper._task is not None
        keeper._task.future.cancel()

    monkeypatch.setattr(WorkerProcess, "__init__", given_up)
    with WorkerPool(1, 20.0, MEMORY) as pool:
        future = pool.submit(slow_mark, tmp_path / "mark", 0.0)
    assert future.cancelled()
    assert not (tmp_path / "mark").exists()
