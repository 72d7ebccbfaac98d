"""A pool of worker processes that cannot lose a task.

Each process has a keeper, a thread of this process, and each task that is under way has one
keeper, which does nothing but wait: for the answer, for the end of the process, for the task's
deadline, or for the word that nobody wants it any more. One of these comes, so every future
settles, whatever is killed at whatever moment.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from modalmotion.errors import LimitError
from modalmotion.store.disk.atomic import cannot_write
from modalmotion.store.disk.faults import is_of_the_machine
from modalmotion_service.errors import ClusterError, NoWorkerError, WorkerDiedError
from modalmotion_service.work.answers import AnswerError, from_bytes, result_type
from modalmotion_service.work.executor import Engine
from modalmotion_service.work.payload import payload_of
from modalmotion_service.work.process import (
    DeadlineError,
    ProcessLostError,
    WokenError,
    WorkerProcess,
)

P = ParamSpec("P")
T = TypeVar("T")

logger = logging.getLogger(__name__)

# Processes that are begun for one task until one of them starts.
MOST_STARTS: Final = 5

# In which a process that does nothing must say that it is there.
READY_SECONDS: Final = 2.0


@dataclass(eq=False)
class _Task:
    future: Future[Any]
    function: Callable[..., Any]
    request: bytes
    attempts: int
    seconds: float


def unreadable_answer() -> WorkerDiedError:
    """Make the error for a process that answers what no task of ours would."""
    return WorkerDiedError(
        "The process at work on this gave an answer that cannot be read.",
        remedy="The input may break a reader; try to send it in another format.",
    )


class WorkerPool(Engine):
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
        self._task_seconds = task_seconds
        self._memory_bytes = memory_bytes
        self._attempts = attempts
        self._seconds_limit = seconds_limit
        self._changed = threading.Condition()
        self._waiting: deque[_Task] = deque()
        self._is_open = True
        self._is_ending = False
        self._keepers = [_Keeper(self) for _ in range(n_workers)]

    @property
    def n_workers(self) -> int:
        """Processes."""
        return len(self._keepers)

    def require_ready(self) -> None:
        """Check that a process is at work, or says that it is there.

        Those that are idle are asked, all at once; one that does not answer is replaced.

        Raises
        ------
        NoWorkerError
            If there is none.
        """
        with self._changed:
            answers = [keeper.asked(READY_SECONDS) for keeper in self._keepers]
            self._changed.notify_all()
        with contextlib.suppress(TimeoutError):
            for answer in as_completed(answers, timeout=READY_SECONDS):
                if not answer.cancelled() and answer.exception() is None:
                    return
        raise NoWorkerError(
            f"None of the {self.n_workers} worker processes answered within {READY_SECONDS:g} s.",
            remedy="Those that are stuck are replaced: try again soon. If it stays so, look after "
            "the machine's memory and its limit on processes.",
            details={"workers": self.n_workers, "seconds": READY_SECONDS},
        )

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a task in a worker; cancelling the future ends its process."""
        future: Future[T] = Future()
        request = payload_of(fn, args, kwargs)
        task = _Task(future, fn, request, self._attempts, self._task_seconds)
        with self._changed:
            if not self._is_open:
                raise RuntimeError("The worker pool takes no more tasks.")
            self._waiting.append(task)
            self._changed.notify()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those under way, or end them if asked to."""
        with self._changed:
            self._is_open = False
            # Nobody is left who would start what waits.
            self._is_ending |= cancel_futures or not wait
            given_up = list(self._waiting) if self._is_ending else []
            if self._is_ending:
                self._waiting.clear()
            self._changed.notify_all()
        for task in given_up:
            task.future.cancel()
        if self._is_ending:
            for keeper in self._keepers:
                keeper.wake()
        if wait:
            for keeper in self._keepers:
                keeper.join()

    def next_task(self, keeper: _Keeper) -> _Task | None:
        """Wait for a task; None when there will be no more. Called by keepers."""
        with self._changed:
            while True:
                if (question := keeper.question) is not None:
                    keeper.task = question
                    return question
                while self._waiting:
                    task = self._waiting.popleft()
                    if not task.future.cancelled():
                        keeper.task = task
                        return task
                if not self._is_open:
                    return None
                self._changed.wait()

    @property
    def is_ending(self) -> bool:
        """Whether tasks that are under way are to be ended."""
        return self._is_ending

    @property
    def memory_bytes(self) -> int:
        """Address space of each process."""
        return self._memory_bytes

    def explain(self, error: BaseException) -> BaseException:
        """Say what the error of a task means to whoever sent it."""
        if isinstance(error, DeadlineError):
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
        if isinstance(error, ProcessLostError):
            return WorkerDiedError(
                f"The process at work on this ended {self._attempts} times in a row.",
                remedy="The input may break a reader; try to send it in another format.",
            )
        if isinstance(error, AnswerError):
            return unreadable_answer()
        if isinstance(error, OSError) and is_of_the_machine(error):
            return cannot_write(Path(error.filename or "a file of the work"), error)
        return error


class _Keeper:
    """The thread that keeps one process, and one task at a time."""

    def __init__(self, pool: WorkerPool) -> None:
        self._pool = pool
        self._process: WorkerProcess | None = None
        self.task: _Task | None = None
        self._question: _Task | None = None
        self._waker, self._wake = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._is_over = False
        self._closing = threading.Lock()
        self._thread = threading.Thread(target=self._keep, name="keeper", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Have it look up from what it waits for."""
        # Not into a file that has the number of a pipe that is closed.
        with self._closing, contextlib.suppress(OSError):
            if not self._is_over:
                os.write(self._wake, b".")

    def join(self) -> None:
        """Wait for its end."""
        self._thread.join()

    def asked(self, seconds: float) -> Future[Any]:
        """Have its process say that it is there; settled with an error if it does not."""
        process, question = self._process, self._question
        if self.task not in (None, question) and process is not None and not process.is_stopped:
            at_work: Future[Any] = Future()
            at_work.set_result(None)
            return at_work
        if question is None or question.future.done():
            request = payload_of(os.getpid, (), {})
            self._question = question = _Task(Future(), os.getpid, request, 1, seconds)
        return question.future

    @property
    def question(self) -> _Task | None:
        """What `asked` has left for its thread."""
        question = self._question
        return None if question is None or question.future.done() else question

    def _keep(self) -> None:
        try:
            # The first process imports everything that tasks need, before there is one.
            with contextlib.suppress(ProcessLostError):
                self._require_process()
            while (task := self._pool.next_task(self)) is not None:
                self._do(task)
                self.task = None
                del task
        finally:
            if self._process is not None:
                self._process.end()
            with self._closing:
                self._is_over = True
                os.close(self._waker)
                os.close(self._wake)

    def _do(self, task: _Task) -> None:
        """Run a task; its future is settled when this returns, whatever happened."""

        def cancelled(future: Future[Any]) -> None:
            if future.cancelled():
                self.wake()

        task.future.add_done_callback(cancelled)
        try:
            value = self._result(task)
        except WokenError:
            task.future.cancel()
        except BaseException as error:  # noqa: BLE001 (all of them are the future's)
            with contextlib.suppress(InvalidStateError):
                task.future.set_exception(self._pool.explain(error))
        else:
            with contextlib.suppress(InvalidStateError):
                task.future.set_result(value)

    def _result(self, task: _Task) -> Any:
        while True:
            process = self._started(task)
            try:
                answer = self._exchange(process, task)
            except ProcessLostError as error:
                self._replace()
                task.attempts -= 1
                _log_death(task, process)
                if not task.attempts:
                    raise error from None
                continue
            except BaseException:
                # It is still at work on what nobody waits for.
                self._replace()
                raise
            try:
                return from_bytes(answer, result_type(task.function))
            except AnswerError:
                # Whatever it is by now, it is not what was begun.
                self._replace()
                raise

    def _exchange(self, process: WorkerProcess, task: _Task) -> bytes:
        while True:
            self._require_wanted(task)
            try:
                return process.exchange(task.request, task.seconds)
            except WokenError:
                # Perhaps for the task before; the process was sent something either way.
                self._require_wanted(task)
                self._replace()
                process = self._started(task)

    def _require_wanted(self, task: _Task) -> None:
        with contextlib.suppress(BlockingIOError):
            os.read(self._waker, 4096)
        if task.future.cancelled() or self._pool.is_ending:
            raise WokenError

    def _started(self, task: _Task) -> WorkerProcess:
        """Give a process that lives; what was killed while it was idle costs no attempt."""
        for _ in range(MOST_STARTS):
            self._require_wanted(task)
            with contextlib.suppress(ProcessLostError):
                return self._require_process()
        raise ClusterError(
            f"No process could be started for the work, {MOST_STARTS} times in a row.",
            remedy="Try again soon; an operator should look after memory and the limit on "
            "processes.",
            details={"tries": MOST_STARTS},
        )

    def _require_process(self) -> WorkerProcess:
        if self._process is not None and not self._process.is_alive:
            self._replace()
        if self._process is None:
            self._process = WorkerProcess(self._pool.memory_bytes, self._waker)
        return self._process

    def _replace(self) -> None:
        if self._process is not None:
            self._process.end()
            self._process = None


def _log_death(task: _Task, process: WorkerProcess) -> None:
    code = process.exit_code()
    logger.warning(
        "a process ended in the middle of its work",
        extra={
            "task": getattr(task.function, "__name__", "other"),
            # 9 is how the kernel ends what takes too much of the machine's memory.
            "signal": -code if code is not None and code < 0 else None,
            "exit_code": code if code is not None and code >= 0 else None,
            "attempts_left": task.attempts,
        },
    )
