"""A keeper: the thread that keeps one worker process, and one task at a time."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from dataclasses import dataclass
from typing import Any, Final

from modalmotion_service.errors import ClusterError
from modalmotion_service.work.answers import AnswerError, from_bytes, result_type
from modalmotion_service.work.lanes import LANE_SECONDS, Lanes, Task
from modalmotion_service.work.process import (
    DeadlineError,
    ProcessLostError,
    WokenError,
    WorkerProcess,
)

logger = logging.getLogger(__name__)

# Processes that are begun for one task until one of them starts.
MOST_STARTS: Final = 5


@dataclass(frozen=True)
class Rules:
    """What holds for all processes of a pool.

    Parameters
    ----------
    memory_bytes : int
    explain : callable
        Says what the error of a task means to whoever sent it.
    is_batch : bool
        Whether workers leave a core to what wakes up: the lane's own process, and the service.
    is_eager : bool
        Whether processes are begun before there is a task.
    """

    memory_bytes: int
    explain: Callable[[BaseException, Task], BaseException]
    is_batch: bool = False
    is_eager: bool = True


class Keeper:
    """The thread that keeps one process, and one task at a time.

    Parameters
    ----------
    lanes : Lanes
        Where tasks come from.
    rules : Rules
    is_lane : bool
        Whether it takes short work alone, and gives up what is not.
    """

    def __init__(self, lanes: Lanes, rules: Rules, *, is_lane: bool = False) -> None:
        self._lanes = lanes
        self._rules = rules
        self._is_lane = is_lane
        self._process: WorkerProcess | None = None
        self._task: Task | None = None
        self._question: Task | None = None
        self._is_ending = False
        self._waker, self._wake = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._is_over = False
        self._closing = threading.Lock()
        self._thread = threading.Thread(target=self._keep, name="keeper", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Have it end what is under way."""
        self._is_ending = True
        self._look_up()

    def join(self) -> None:
        """Wait for its end."""
        self._thread.join()

    def asked(self, seconds: float) -> Future[Any]:
        """Have its process say that it is there; settled with an error if it does not."""
        process, question = self._process, self._question
        if self._task not in (None, question) and process is not None and not process.is_stopped:
            at_work: Future[Any] = Future()
            at_work.set_result(None)
            return at_work
        if question is None or question.future.done():
            self._question = question = Task(Future(), os.getpid, b"", 1, seconds)
        return question.future

    def _next_question(self) -> Task | None:
        """Give what `asked` has left for its thread."""
        question = self._question
        return None if question is None or question.future.done() else question

    def _look_up(self) -> None:
        # Not into a file that has the number of a pipe that is closed.
        with self._closing, contextlib.suppress(OSError):
            if not self._is_over:
                os.write(self._wake, b".")

    def _keep(self) -> None:
        try:
            if self._rules.is_eager:
                # The first one waits for all imports, before there is a task.
                with contextlib.suppress(ProcessLostError):
                    self._require_process()
            while (task := self._next_task()) is not None:
                self._do(task)
                self._task = None
                del task
        finally:
            if self._process is not None:
                self._process.end()
            with self._closing:
                self._is_over = True
                os.close(self._waker)
                os.close(self._wake)

    def _next_task(self) -> Task | None:
        self._task = self._lanes.take(self._next_question, is_lane=self._is_lane)
        return self._task

    def _do(self, task: Task) -> None:
        """Run a task; its future is settled when this returns, or it is in the queue again."""

        def cancelled(future: Future[Any]) -> None:
            if future.cancelled() and self._task is task:
                self._look_up()

        task.future.add_done_callback(cancelled)
        try:
            value = self._result(task)
        except WokenError:
            task.future.cancel()
        except BaseException as error:  # noqa: BLE001 (all of them are the future's)
            if self._is_lane and task.looks_short and isinstance(error, DeadlineError):
                if not self._lanes.put_back(task):
                    task.future.cancel()
                return
            with contextlib.suppress(InvalidStateError):
                task.future.set_exception(self._rules.explain(error, task))
        else:
            with contextlib.suppress(InvalidStateError):
                task.future.set_result(value)

    def _result(self, task: Task) -> Any:
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

    def _exchange(self, process: WorkerProcess, task: Task) -> bytes:
        seconds = task.seconds
        if self._is_lane and task.looks_short:
            seconds = min(seconds, LANE_SECONDS)
        while True:
            self._require_wanted(task)
            try:
                return process.exchange(task.request, seconds, task.terms.most_seconds)
            except WokenError:
                # Perhaps for the task before; the process was sent something either way.
                self._require_wanted(task)
                self._replace()
                process = self._started(task)

    def _require_wanted(self, task: Task) -> None:
        with contextlib.suppress(BlockingIOError):
            os.read(self._waker, 4096)
        if task.future.cancelled() or self._is_ending:
            raise WokenError

    def _started(self, task: Task) -> WorkerProcess:
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
            is_batch = self._rules.is_batch and not self._is_lane
            self._process = WorkerProcess(self._rules.memory_bytes, self._waker, is_batch=is_batch)
        return self._process

    def _replace(self) -> None:
        if self._process is not None:
            self._process.end()
            self._process = None


def _log_death(task: Task, process: WorkerProcess) -> None:
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
