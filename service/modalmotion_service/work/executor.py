"""Work in disposable processes, behind the standard `Executor`.

A task that crashes, hangs or swallows memory costs itself and nothing else: its process is
replaced. Tasks are functions of a module, carry paths and small values, and may run twice.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import multiprocessing
import os
import resource
import signal
import threading
from abc import abstractmethod
from collections import deque
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, InvalidStateError
from concurrent.futures import TimeoutError as TaskTimeoutError
from concurrent.futures import wait as wait_for
from dataclasses import dataclass
from multiprocessing.connection import wait as wait_for_any
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import pebble

from modalmotion.errors import LimitError
from modalmotion.store.disk.atomic import cannot_write
from modalmotion_service.errors import ClusterError, WorkerDiedError
from modalmotion_service.work.allocation import keep_freed_memory

P = ParamSpec("P")
T = TypeVar("T")

logger = logging.getLogger(__name__)

_PRELOADED: Final = [
    f"modalmotion_service.work.tasks.{name}"
    for name in ("sequences", "signatures", "templates", "derived", "codec", "classification")
]

# Processes that are begun for one task until one of them starts.
_MOST_STARTS: Final = 5


# What a task meets where its files lie, and none of its doing.
_OF_THE_DISK: Final = frozenset(
    {
        *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO),
        *(errno.ESTALE, errno.EMFILE, errno.ENFILE),
    }
)

# Freed memory that a worker keeps: a signature of 1 MB needs 4 MB for a moment.
_KEPT_BYTES: Final = 8 << 20


@dataclass
class _Task:
    future: Future[Any]
    function: Callable[..., Any]
    args: tuple[Any, ...]
    kwargs: dict[str, Any]
    attempts: int


class Engine(Executor):
    """An executor of tasks that says how much it does at once, and whether it can."""

    @property
    @abstractmethod
    def n_workers(self) -> int:
        """Tasks that run at the same time."""

    @abstractmethod
    def require_ready(self) -> None:
        """Raise ClusterError if a task could not be run now."""


class WorkerPool(Engine):
    """Processes with a limit on time and on memory for each task.

    Each process is a pebble pool of one. In a pool of several an idle process holds the lock
    of the queue that all of them read: killed there, by the kernel's want of memory say, it
    leaves the others to wait for a minute and the pool broken for good.

    Parameters
    ----------
    n_workers : int
    task_seconds : float
        After this a task's process is ended, and its future fails with LimitError.
    memory_bytes : int
        Address space of each process; a task that needs more fails with LimitError.
    attempts : int
        How often a task whose process died is tried.
    seconds_limit : str
        What errors call the limit on time.
    """

    def __init__(
        self,
        n_workers: int,
        task_seconds: float,
        memory_bytes: int,
        attempts: int = 3,
        seconds_limit: str = "task_seconds",
    ) -> None:
        self._n_workers = n_workers
        self._seconds_limit = seconds_limit
        self._n_workers = n_workers
        self._task_seconds = task_seconds
        self._memory_bytes = memory_bytes
        self._attempts = attempts
        self._lock = threading.Lock()
        self._waiting: deque[_Task] = deque()
        self._free: list[pebble.ProcessPool] = []
        self._busy: set[pebble.ProcessPool] = set()
        self._settled = threading.Condition(self._lock)
        self._is_open = True
        # The first process imports everything that tasks need: whoever submits the first task
        # is not to wait for that, least of all an event loop.
        self._opening = threading.Thread(target=self._open_processes, args=[n_workers])
        self._opening.start()

    @property
    def n_workers(self) -> int:
        """Processes."""
        return self._n_workers

    def require_ready(self) -> None:
        """Do nothing: a process that is lost is replaced at once."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a task in a worker; cancelling the future ends its process."""
        future: Future[T] = Future()
        task = _Task(future, fn, args, kwargs, self._attempts)
        with self._lock:
            if not self._is_open:
                raise RuntimeError("The worker pool takes no more tasks.")
            self._waiting.append(task)
        self._start_waiting()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those under way, or end them if asked to."""
        with self._lock:
            self._is_open = False
            if cancel_futures:
                for task in self._waiting:
                    task.future.cancel()
                self._waiting.clear()
            elif wait:
                self._settled.wait_for(lambda: not self._waiting and not self._busy)
        self._opening.join()
        with self._lock:
            processes = [*self._free, *self._busy]
        for process in processes:
            process.stop()
        if wait:
            for process in processes:
                process.join()
        else:
            # What is only stopped stays, with its process, for as long as this one lives.
            _dispose_apart(*processes)

    def _open_processes(self, n_workers: int) -> None:
        for _ in range(n_workers):
            process = self._new_process()
            with contextlib.suppress(RuntimeError, OSError):
                # Whatever becomes of it: a process that is lost is replaced when it is needed.
                wait_for([process.schedule(abs, args=[0])])
            with self._lock:
                self._free.append(process)
            self._start_waiting()
            if not self._is_open:
                # One is enough for what still waits.
                return

    def _new_process(self) -> pebble.ProcessPool:
        # A worker is forked from a process that has imported what tasks need and opened
        # nothing: it starts at once, and inherits no lock, socket or database connection.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(_PRELOADED)
        return pebble.ProcessPool(
            max_workers=1,
            context=context,
            initializer=_start_worker,
            initargs=[self._memory_bytes],
        )

    def _start_waiting(self) -> None:
        while True:
            with self._lock:
                while self._waiting and self._waiting[0].future.cancelled():
                    self._waiting.popleft()
                if not self._waiting or not self._free:
                    self._settled.notify_all()
                    return
                task, process = self._waiting.popleft(), self._free.pop()
                self._busy.add(process)
            self._run(task, process)

    def _run(self, task: _Task, process: pebble.ProcessPool) -> None:
        for _ in range(_MOST_STARTS):
            try:
                inner = process.schedule(
                    task.function, args=task.args, kwargs=task.kwargs, timeout=self._task_seconds
                )
                break
            except (RuntimeError, OSError):
                # Killed while it was idle, or not started: nothing of the task has happened.
                process = self._replaced(process)
        else:
            self._release(process)
            with contextlib.suppress(InvalidStateError):
                task.future.set_exception(_cannot_start())
            return

        def finish(done: Future[Any]) -> None:
            error = None if done.cancelled() else done.exception()
            died = isinstance(error, (pebble.ProcessExpired, BrokenExecutor))
            kept = self._replaced(process) if isinstance(error, BrokenExecutor) else process
            task.attempts -= died
            if died and not task.future.cancelled():
                _log_death(task, error)
            if died and task.attempts and not task.future.cancelled():
                self._run(task, kept)
                self._start_waiting()
                return
            self._release(kept)
            # The next task first: whoever waits for this one may ask for another at once.
            self._start_waiting()
            with contextlib.suppress(InvalidStateError):
                if done.cancelled():
                    task.future.cancel()
                elif error is None:
                    task.future.set_result(done.result())
                else:
                    task.future.set_exception(self._explain(error))

        def cancel(settled: Future[Any]) -> None:
            if settled.cancelled():
                inner.cancel()

        inner.add_done_callback(finish)
        task.future.add_done_callback(cancel)

    def _release(self, process: pebble.ProcessPool) -> None:
        with self._lock:
            self._busy.discard(process)
            self._free.append(process)

    def _replaced(self, process: pebble.ProcessPool) -> pebble.ProcessPool:
        """Put a new process in the place of a broken one."""
        new = self._new_process()
        with self._lock:
            self._busy.discard(process)
            self._busy.add(new)
        # Its own threads call this, and cannot wait for their own end.
        _dispose_apart(process)
        return new

    def _explain(self, error: BaseException) -> BaseException:
        if isinstance(error, TaskTimeoutError):
            return LimitError(
                f"The work took longer than {self._task_seconds:g} s and was ended.",
                remedy="Send fewer frames or a coarser mesh, ask for fewer modes, or have the "
                "limit raised.",
                limit=self._seconds_limit,
                details={"most": self._task_seconds},
            )
        if isinstance(error, MemoryError):
            return LimitError(
                f"The work needs more memory than the {self._memory_bytes} bytes it may take.",
                remedy="Send fewer frames or a coarser mesh, or have the limit raised.",
                limit="task_memory_bytes",
                details={"most": self._memory_bytes},
            )
        if isinstance(error, (pebble.ProcessExpired, BrokenExecutor)):
            return WorkerDiedError(
                f"The process at work on this ended {self._attempts} times in a row.",
                remedy="The input may break a reader; try to send it in another format.",
            )
        if isinstance(error, OSError) and error.errno in _OF_THE_DISK:
            return cannot_write(Path(error.filename or "a file of the work"), error)
        return error


def _cannot_start() -> ClusterError:
    return ClusterError(
        f"No process could be started for the work, {_MOST_STARTS} times in a row.",
        remedy="Try again soon; an operator should look after memory and the limit on processes.",
        details={"tries": _MOST_STARTS},
    )


def _log_death(task: _Task, error: BaseException | None) -> None:
    code = getattr(error, "exitcode", None)
    logger.warning(
        "a process ended in the middle of its work",
        extra={
            "task": getattr(task.function, "__name__", "other"),
            # 9 is how the kernel ends what takes too much of the machine's memory.
            "signal": -code if isinstance(code, int) and code < 0 else None,
            "exit_code": code if isinstance(code, int) and code >= 0 else None,
            "attempts_left": task.attempts,
        },
    )


def _dispose_apart(*processes: pebble.ProcessPool) -> None:
    def dispose() -> None:
        for process in processes:
            process.stop()
            process.join()

    threading.Thread(target=dispose, daemon=True).start()


def _start_worker(memory_bytes: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    keep_freed_memory(_KEPT_BYTES)
    # The server decides when its workers end, not a Ctrl-C that reaches the whole group.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    # A server that is killed leaves its workers behind: what they would still write may by then
    # be another worker's work.
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for_any([parent.sentinel])
        os._exit(1)
