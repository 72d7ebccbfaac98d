"""Work in disposable processes, behind the standard `Executor`.

A task that crashes, hangs or swallows memory costs itself and nothing else: its process is
replaced. Tasks are functions of a module, carry paths and small values, and may run twice.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import resource
import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future, InvalidStateError
from concurrent.futures import TimeoutError as TaskTimeoutError
from typing import Any, ParamSpec, TypeVar

import pebble

from modalmotion.errors import LimitError, ModalMotionError

P = ParamSpec("P")
T = TypeVar("T")


class WorkerDiedError(ModalMotionError):
    """A worker process ended in the middle of a task, more than once."""

    code = "worker_died"


class WorkerPool(Executor):
    """Processes with a limit on time and on memory for each task.

    Parameters
    ----------
    n_workers : int
    task_seconds : float
        After this a task's process is ended, and its future fails with LimitError.
    memory_bytes : int
        Address space of each process; a task that needs more fails with LimitError.
    attempts : int
        How often a task whose process died is tried.
    """

    def __init__(
        self, n_workers: int, task_seconds: float, memory_bytes: int, attempts: int = 2
    ) -> None:
        self._task_seconds = task_seconds
        self._memory_bytes = memory_bytes
        self._attempts = attempts
        self._pool = pebble.ProcessPool(
            max_workers=n_workers,
            # spawn: a worker inherits no thread, lock, socket or database connection.
            context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=[memory_bytes],
        )

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a task in a worker; cancelling the future ends its process."""
        outer: Future[T] = Future()
        self._schedule(outer, fn, args, kwargs, self._attempts)
        return outer

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; end those under way if asked to, else finish them."""
        if cancel_futures:
            self._pool.stop()
        else:
            self._pool.close()
        if wait:
            self._pool.join()

    def _schedule(
        self,
        outer: Future[T],
        fn: Callable[..., T],
        args: tuple[Any, ...],
        kwargs: dict[str, Any],
        attempts: int,
    ) -> None:
        inner = self._pool.schedule(fn, args=args, kwargs=kwargs, timeout=self._task_seconds)

        def finish(done: Future[T]) -> None:
            if outer.cancelled():
                return
            if done.cancelled():
                outer.cancel()
                return
            error = done.exception()
            if isinstance(error, pebble.ProcessExpired) and attempts > 1:
                self._schedule(outer, fn, args, kwargs, attempts - 1)
            elif error is None:
                _settle(outer.set_result, done.result())
            else:
                _settle(outer.set_exception, self._explain(error))

        def cancel(settled: Future[T]) -> None:
            if settled.cancelled():
                inner.cancel()

        inner.add_done_callback(finish)
        outer.add_done_callback(cancel)

    def _explain(self, error: BaseException) -> BaseException:
        if isinstance(error, TaskTimeoutError):
            return LimitError(
                f"The work took longer than {self._task_seconds:g} s and was ended.",
                remedy="Send fewer frames or a coarser mesh, ask for fewer modes, or have the "
                "limit raised.",
                limit="task_seconds",
                details={"most": self._task_seconds},
            )
        if isinstance(error, MemoryError):
            return LimitError(
                f"The work needs more memory than the {self._memory_bytes} bytes it may take.",
                remedy="Send fewer frames or a coarser mesh, or have the limit raised.",
                limit="task_memory_bytes",
                details={"most": self._memory_bytes},
            )
        if isinstance(error, pebble.ProcessExpired):
            return WorkerDiedError(
                f"The process at work on this ended {self._attempts} times in a row.",
                remedy="The input may break a reader; try to send it in another format.",
            )
        return error


def _settle(set_outcome: Callable[[Any], None], outcome: object) -> None:
    # Cancelled in the same moment: the outcome is wanted no more.
    with contextlib.suppress(InvalidStateError):
        set_outcome(outcome)


def _start_worker(memory_bytes: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    # The server decides when its workers end, not a Ctrl-C that reaches the whole group.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
