"""A worker process: begun with a deadline, spoken to with a deadline, ended for certain.

Of a process nothing is believed but its end of a socket: it is alive while that is open. Neither
the fork server nor the resource tracker is asked, which may be killed or stopped like any other.
"""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import pickle
import resource
import select
import signal
import socket
import threading
import time
from multiprocessing import forkserver
from multiprocessing.connection import wait as wait_for_any
from typing import Any, Final

from modalmotion_service.work.allocation import keep_freed_memory
from modalmotion_service.work.answers import answer_of
from modalmotion_service.work.fork_server import PRELOADED
from modalmotion_service.work.parsing import begin_parsers
from modalmotion_service.work.temporary import require_temporary_folder

# For a process to be forked and to say that it is there. The first imports all that tasks need.
_START_SECONDS: Final = 60.0

# Between two looks at a process that is waited for: whether it has been stopped, and what it has
# taken; and between two when it has little left.
_LOOK_SECONDS: Final = 0.5
_LEAST_LOOK_SECONDS: Final = 0.02

# Freed memory that a worker keeps: a signature of 1 MB needs 4 MB for a moment.
_KEPT_BYTES: Final = 8 << 20

# A third of a core's share beside what is as usual: less starves workers on a machine with others.
_NICENESS: Final = 5

_PREFIX: Final = 8
# Of an answer at a time: most are whole in the first piece.
_FIRST_PIECE: Final = 1 << 16
_PIECE: Final = 1 << 20

# One at a time: whoever finds that the fork server does not answer ends it for the next.
_STARTING = threading.Lock()


class ProcessLostError(Exception):
    """A process ended, or could not be begun."""


class DeadlineError(Exception):
    """A process was not done in time."""


class SpentError(Exception):
    """A process has taken the processor time that it may take."""


class WokenError(Exception):
    """Somebody wants what is waited for no more."""


# What a process that cannot be begun, or says nothing of sense, may raise.
_NO_PROCESS: Final = (OSError, EOFError, RuntimeError, DeadlineError, UserWarning, ValueError)


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
        self._process: Any = None
        # The process that forks its parsers.
        self._forks = 0
        try:
            with theirs:
                self._process = _begun(theirs, memory_bytes, is_batch)
            ours.setblocking(False)
            ready = self._receive(time.monotonic() + _START_SECONDS, wakes=False)
            self._forks = int(ready)
        except BaseException as error:
            self.end()
            if isinstance(error, _NO_PROCESS):
                raise ProcessLostError(f"no process: {type(error).__name__}: {error}") from error
            raise

    @property
    def pid(self) -> int:
        """Its number."""
        return int(self._process.pid)

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
        return any(map(_is_stopped, (self.pid, *self._parsers())))

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
        """Code that it ended with, negative for a signal; None where nobody knows."""
        with contextlib.suppress(OSError, ValueError, AssertionError, EOFError):
            self._process.join(0.5)
            code = self._process.exitcode
            return None if code is None else int(code)
        return None

    def end(self) -> None:
        """End it, whatever it does."""
        # While its end of the socket is open the number is its own and nobody else's.
        if self._process is not None and self.is_alive:
            with contextlib.suppress(OSError):
                os.kill(self.pid, signal.SIGKILL)
        self._socket.close()

    def _parsers(self) -> list[int]:
        """Give the process that forks its parsers, and the one parser that lives."""
        if not self._forks:
            return []
        children = _told(self._forks, f"task/{self._forks}/children")
        return [self._forks, *map(int, children.split())]

    def _spent(self) -> float:
        """Processor time that it and its parsers have taken so far, in s."""
        processes = (self.pid, *self._parsers())
        return sum(map(_processor_clock, processes)) + _spent_by_children(self._forks)

    def _send(self, request: bytes, deadline: float) -> None:
        left = memoryview(len(request).to_bytes(_PREFIX, "little") + request)
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
        while len(data) < _PREFIX:
            data += self._piece(_FIRST_PIECE, deadline, wakes=wakes)
        length = _PREFIX + int.from_bytes(data[:_PREFIX], "little")
        while len(data) < length:
            data += self._piece(min(_PIECE, length - len(data)), deadline, wakes=wakes)
        if len(data) > length:
            # It would be taken for the answer to the next question.
            raise ProcessLostError("it said more than it was asked")
        return bytes(memoryview(data)[_PREFIX:])

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
            if (is_stopped := self._process is not None and self.is_stopped) and was_stopped:
                raise ProcessLostError("it was stopped")
            was_stopped = is_stopped
            if self._most_clock < math.inf:
                if (means := self._most_clock - self._spent()) <= 0:
                    raise SpentError
                next_look = min(_LOOK_SECONDS, max(means, _LEAST_LOOK_SECONDS))
        raise DeadlineError


def _told(pid: int, name: str) -> bytes:
    """Give what the system tells of a process, as proc(5) has it; nothing of one that is gone."""
    try:
        # As one call each: this is done for every task.
        file = os.open(f"/proc/{pid}/{name}", os.O_RDONLY)
        try:
            return os.read(file, 4096)
        finally:
            os.close(file)
    except OSError:
        return b""


def _spent_by_children(pid: int) -> float:
    """Processor time of the children of a process that have ended, in s."""
    fields = _told(pid, "stat").rpartition(b")")[2].split()
    return (int(fields[13]) + int(fields[14])) / os.sysconf("SC_CLK_TCK") if fields else 0.0


def _processor_clock(pid: int) -> float:
    """Processor time of a process so far, in s; 0 where the system does not tell."""
    try:
        # As clock_getcpuclockid(3) of Linux makes the number of a process's clock.
        return time.clock_gettime((~pid << 3) | 2)
    except OSError:
        return 0.0


def _begun(theirs: socket.socket, memory_bytes: int, is_batch: bool) -> Any:
    # A worker is forked from a process that has imported what tasks need and opened nothing: it
    # starts at once, and inherits no lock, socket or database connection.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    process = context.Process(target=_work, args=(theirs, memory_bytes, is_batch), daemon=True)
    with _STARTING:
        # A fork server that is stopped answers nobody; one that is gone is begun anew.
        watch = threading.Timer(_START_SECONDS, _end_fork_server)
        watch.daemon = True
        watch.start()
        try:
            # Without its folder it is never found again.
            if not require_temporary_folder():
                _end_fork_server()
            if _is_stopped(forkserver._forkserver._forkserver_pid):  # type: ignore[attr-defined]
                _end_fork_server()
            process.start()
        finally:
            watch.cancel()
            # At its end the interpreter would wait for it, stopped or not; it ends by itself.
            multiprocessing.process._children.discard(process)  # type: ignore[attr-defined]
    return process


def _is_stopped(pid: int | None) -> bool:
    """Tell whether a signal has stopped a process, as proc(5) shows it."""
    return pid is not None and _told(pid, "stat").rpartition(b")")[2].split()[:1] == [b"T"]


def _end_fork_server() -> None:
    pid = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    if pid is not None:
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGKILL)
            # Until then it would be taken for alive.
            os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)


def _work(ours: socket.socket, memory_bytes: int, is_batch: bool) -> None:
    """Answer requests until the socket closes: what runs in the process."""
    if is_batch:
        with contextlib.suppress(OSError, AttributeError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        os.nice(_NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    keep_freed_memory(_KEPT_BYTES)
    # The server decides when its workers end, not a Ctrl-C that reaches the whole group.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Before anything is read, and before there are threads.
    forks = begin_parsers()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _answer(ours, str(forks).encode())
    with ours.makefile("rb") as requests:
        while length := int.from_bytes(requests.read(_PREFIX), "little"):
            # From our own server: only answers come from where strangers' files are read.
            function, args, kwargs = pickle.loads(requests.read(length))  # noqa: S301
            _answer(ours, answer_of(function, args, kwargs))
            del function, args, kwargs
    os._exit(0)


def _answer(ours: socket.socket, data: bytes) -> None:
    # Whoever waits wakes up for each piece.
    ours.sendall(len(data).to_bytes(_PREFIX, "little") + data[:_FIRST_PIECE])
    if rest := memoryview(data)[_FIRST_PIECE:]:
        ours.sendall(rest)


def _end_with_parent() -> None:
    # A server that is killed leaves its workers behind: what they would still write may by then
    # be another worker's work.
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for_any([parent.sentinel])
        os._exit(1)
