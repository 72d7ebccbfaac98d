"""A worker process and the thread that keeps it, with one task at a time.

It is begun with a deadline, spoken to with a deadline, and ended for certain. Of a process nothing
is believed but its end of a socket: it is alive while that is open.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import select
import signal
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from dataclasses import dataclass
from typing import Any, Final

from modalmotion_service.errors import ClusterError
from modalmotion_service.work.answers import AnswerError, from_bytes, result_type
from modalmotion_service.work.forks import FORKS, is_stopped, told
from modalmotion_service.work.lanes import LANE_SECONDS, Lanes, Task
from modalmotion_service.work.worker import FIRST_PIECE, PREFIX

# For a process to say that it is there.
_START_SECONDS: Final = 60.0

# Between two looks at a process that is waited for: whether it has been stopped, and what it has
# taken; and between two when it has little left.
_LOOK_SECONDS: Final = 0.5
_LEAST_LOOK_SECONDS: Final = 0.02

# Of a long answer at a time.
_PIECE: Final = 1 << 20


class ProcessLostError(Exception):
    """A process ended, or could not be begun."""


class DeadlineError(Exception):
    """A process was not done in time."""


class SpentError(Exception):
    """A process has taken the processor time that it may take."""


class WokenError(Exception):
    """Somebody wants what is waited for no more."""


# What a process that cannot be begun, or says nothing of sense, may raise.
_NO_PROCESS: Final = (OSError, DeadlineError, ProcessLostError, ValueError)


class WorkerProcess:
    """One worker process, and the socket that leads to it.

    Parameters
    ----------
    memory_bytes : int
        Its address space.
    waker : int
        File descriptor that becomes readable when whoever waits is to look up.
    is_batch : bool
        Whether it leaves a core to what wakes up.

    Raises
    ------
    ProcessLostError
        If it cannot be begun.
    """

    def __init__(self, memory_bytes: int, waker: int, *, is_batch: bool = False) -> None:
        self._waker = waker
        self._most_clock = math.inf
        ours, theirs = socket.socketpair()
        self._socket = ours
        self._polls: dict[tuple[int, bool], select.poll] = {}
        self.pid = 0
        try:
            with theirs:
                self.pid = FORKS.fork(theirs, memory_bytes, is_batch)
            ours.setblocking(False)
            self._receive(time.monotonic() + _START_SECONDS, wakes=False)
        except BaseException as error:
            self.end()
            if isinstance(error, _NO_PROCESS):
                raise ProcessLostError(f"no process: {type(error).__name__}: {error}") from error
            raise

    @property
    def is_alive(self) -> bool:
        """Whether its end of the socket is open."""
        try:
            return self._socket.recv(1, socket.MSG_PEEK) != b""
        except BlockingIOError:
            return True
        except OSError:
            return False

    @property
    def is_stopped(self) -> bool:
        """Whether a signal has stopped it or its parser: it will do nothing until another one."""
        return any(map(is_stopped, (self.pid, *self._parsers())))

    def exchange(
        self, request: bytes, seconds: float, processor_seconds: float = math.inf
    ) -> bytes:
        """Send a request and wait for the answer.

        Raises
        ------
        ProcessLostError
            If the process ends before it has answered, or is stopped.
        DeadlineError
            If it has not answered in time.
        SpentError
            If it has taken so much processor time before it has answered.
        WokenError
            If the waker becomes readable first.
        """
        deadline = time.monotonic() + seconds
        self._most_clock = self._spent() + processor_seconds
        self._send(request, deadline)
        return self._receive(deadline)

    def exit_code(self) -> int | None:
        """Code that it ended with, negative for a signal; None if nobody knows."""
        return FORKS.exit_code(self.pid)

    def end(self) -> None:
        """End it, whatever it does."""
        self.kill()
        self._socket.close()

    def kill(self) -> None:
        """Have the system end it."""
        # While its end of the socket is open the number is its own and nobody else's.
        if self.pid and self.is_alive:
            with contextlib.suppress(OSError):
                os.kill(self.pid, signal.SIGKILL)

    def _parsers(self) -> list[int]:
        """Give the process that forks its parsers, and the one parser that lives."""
        forks = _children(self.pid)
        return [*forks, *(parser for fork in forks for parser in _children(fork))]

    def _spent(self) -> float:
        """Processor time that it and its parsers have taken so far, in s."""
        forks = _children(self.pid)
        processes = (self.pid, *forks, *(parser for fork in forks for parser in _children(fork)))
        return sum(map(_processor_clock, processes)) + sum(map(_spent_by_children, forks))

    def _send(self, request: bytes, deadline: float) -> None:
        left = memoryview(len(request).to_bytes(PREFIX, "little") + request)
        while left:
            self._wait(select.POLLOUT, deadline, wakes=True)
            try:
                left = left[self._socket.send(left) :]
            except BlockingIOError:
                continue
            except OSError as error:
                raise ProcessLostError("it ended while it was sent a task") from error

    def _receive(self, deadline: float, *, wakes: bool = True) -> bytes:
        data = bytearray()
        while len(data) < PREFIX:
            data += self._piece(FIRST_PIECE, deadline, wakes=wakes)
        length = PREFIX + int.from_bytes(data[:PREFIX], "little")
        while len(data) < length:
            data += self._piece(min(_PIECE, length - len(data)), deadline, wakes=wakes)
        if len(data) > length:
            # It would be taken for the answer to the next question.
            raise ProcessLostError("it said more than it was asked")
        return bytes(memoryview(data)[PREFIX:])

    def _piece(self, most: int, deadline: float, *, wakes: bool) -> bytes:
        """Wait for the next bytes of an answer."""
        while True:
            self._wait(select.POLLIN, deadline, wakes=wakes)
            try:
                piece = self._socket.recv(most)
            except BlockingIOError:
                continue
            except OSError as error:
                raise ProcessLostError("its connection broke") from error
            if not piece:
                raise ProcessLostError("it ended")
            return piece

    def _poll(self, event: int, *, wakes: bool) -> select.poll:
        if (event, wakes) not in self._polls:
            self._polls[event, wakes] = poll = select.poll()
            poll.register(self._socket, event)
            if wakes:
                poll.register(self._waker, select.POLLIN)
        return self._polls[event, wakes]

    def _wait(self, event: int, deadline: float, *, wakes: bool) -> None:
        poll = self._poll(event, wakes=wakes)
        was_stopped = False
        next_look = _LOOK_SECONDS
        while (left := deadline - time.monotonic()) > 0:
            ready = dict(poll.poll(1e3 * min(left, next_look)))
            if self._waker in ready:
                raise WokenError
            if ready:
                return
            # Seen twice: whoever stops a process for a moment only looks at it.
            if (is_stopped_now := self.pid > 0 and self.is_stopped) and was_stopped:
                raise ProcessLostError("it was stopped")
            was_stopped = is_stopped_now
            if self._most_clock < math.inf:
                if (means := self._most_clock - self._spent()) <= 0:
                    raise SpentError
                next_look = min(_LOOK_SECONDS, max(means, _LEAST_LOOK_SECONDS))
        raise DeadlineError


def _children(pid: int) -> list[int]:
    return [*map(int, told(pid, f"task/{pid}/children").split())] if pid else []


def _spent_by_children(pid: int) -> float:
    """Processor time of the children of a process that have ended, in s."""
    fields = told(pid, "stat").rpartition(b")")[2].split()
    return (int(fields[13]) + int(fields[14])) / os.sysconf("SC_CLK_TCK") if fields else 0.0


def _processor_clock(pid: int) -> float:
    """Processor time of a process so far, in s; 0 where the system does not tell."""
    try:
        # As clock_getcpuclockid(3) of Linux makes the number of a process's clock.
        return time.clock_gettime((~pid << 3) | 2)
    except OSError:
        return 0.0


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

    def look(self) -> bool | None:
        """Return whether its process can work: not while it is stopped; None if there is none.

        One that is stopped without a task is ended: there will be another one for the next task.
        """
        process, is_idle = self._process, self._task is None
        if process is None or not process.is_alive:
            return None
        if process.is_stopped:
            if is_idle:
                process.kill()
            return False
        return True

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
            while (task := self._lanes.take(is_lane=self._is_lane)) is not None:
                self._task = task
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
