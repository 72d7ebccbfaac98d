"""The process that workers are forked from: it has imported what tasks need, and opened nothing.

A worker starts at once, and inherits no lock, socket or database connection. Nothing is believed of
this process: it has a deadline for every answer, and one that is stopped or gone is begun anew.
A server that starts imports what both need and forks it, before it opens anything itself.

Of a worker nothing is believed but its end of a socket: it is alive while that is open. No wait for
it is without end: the answer ends it, the end of the process, or a look at it twice a second, which
knows the task's deadline and means, whether a signal has stopped the process, and whether anybody
still wants the task.
"""

import atexit
import contextlib
import gc
import json
import math
import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from importlib import import_module
from multiprocessing import util
from typing import Any, Final

from modalmotion_service.work.engine import PREFIX

# Of SciPy what the tasks use, which they import where they use it: the first task is to be as quick
# as the next.
PRELOADED: Final = [
    *(f"scipy.{name}" for name in ("fft", "interpolate", "linalg", "ndimage", "optimize")),
    *("scipy.sparse.csgraph", "scipy.sparse.linalg", "scipy.spatial.transform", "scipy.special"),
    *(
        f"modalmotion_service.work.tasks.{name}"
        for name in ("sequences", "signatures", "classification", "tracks")
    ),
    "modalmotion_service.work.worker",
]
"""Modules that every worker has from its start."""

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What says how many threads a product of matrices takes."""

# For a process to be forked; the first waits until all that tasks need is imported.
_FORK_SECONDS: Final = 60.0
# For the word how one has ended.
_WORD_SECONDS: Final = 2.0
_REAPING_SECONDS: Final = 0.5
_LONGEST: Final = 200


class Forks:
    """The fork server of this process, as it sees it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._control: socket.socket | None = None
        self.pid = 0

    def split_off(self) -> None:
        """Begin it as a fork of this process, which has one thread and has opened nothing."""
        for name in PRELOADED:
            import_module(name)
        gc.freeze()
        with self._lock:
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self.pid = os.fork()
            if not self.pid:
                ours.close()
                try:
                    serve(theirs.detach())
                finally:
                    os._exit(1)
            theirs.close()
            self._control = ours

    def fork(self, place: socket.socket, *words: object) -> int:
        """Fork a worker that has one end of a socket; gives its number.

        Raises
        ------
        OSError
            If there is none in time; the next one is forked from a new fork server.
        """
        with self._lock:
            if is_stopped(self.pid):
                self._end()
            word, places = json.dumps(words), [place.fileno()]
            try:
                pid = int(self._asked(_FORK_SECONDS, word, places))
            except (BrokenPipeError, ConnectionResetError):
                # It was killed while nobody asked for anything.
                pid = int(self._asked(_FORK_SECONDS, word, places))
        if pid < 0:
            raise OSError(-pid, os.strerror(-pid))
        return pid

    def exit_code(self, pid: int) -> int | None:
        """Code that a worker ended with, negative for a signal; None if nobody knows."""
        with self._lock, contextlib.suppress(OSError, ValueError):
            code: int | None = json.loads(self._asked(_WORD_SECONDS, str(pid), []))
            return code
        return None

    def _asked(self, seconds: float, word: str, places: list[int]) -> str:
        control = self._begun()
        try:
            control.settimeout(seconds)
            socket.send_fds(control, [word.encode()], places)
            if answer := control.recv(_LONGEST):
                return answer.decode()
            raise ConnectionResetError
        except OSError:
            # A late answer would be taken for that to the next question.
            self._end()
            raise

    def _begun(self) -> socket.socket:
        if self._control is None:
            take_one_thread()
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with theirs:
                program = (
                    f"import sys; sys.path[:] = {sys.path!r}; "
                    f"from modalmotion_service.work.forks import serve; serve({theirs.fileno()})"
                )
                flags = [f"-W{option}" for option in sys.warnoptions]
                words = [sys.executable, *flags, "-c", program]
                self.pid = util.spawnv_passfds(
                    os.fsencode(sys.executable), [*map(os.fsencode, words)], [theirs.fileno()]
                )
            self._control = ours
        return self._control

    def close(self) -> None:
        """Close the way to it, after which it ends."""
        if self._control is not None:
            self._control.close()
            self._control = None

    def _end(self) -> None:
        if self._control is not None:
            self.close()
            with contextlib.suppress(OSError):
                os.kill(self.pid, signal.SIGKILL)
                os.waitpid(self.pid, 0)
            self.pid = 0


FORKS: Final = Forks()
"""That of this process."""

atexit.register(FORKS.close)


def take_one_thread() -> None:
    """Have workers, one for each core, take one thread each, unless the environment says otherwise.

    Threads of all would wait for one another, busily, a sixth of all processor time.
    """
    if not any(name in os.environ for name in THREADS):
        os.environ.update(dict.fromkeys(THREADS, "1"))


def is_stopped(pid: int) -> bool:
    """Return whether a signal has stopped a process, as proc(5) shows it."""
    return told(pid, "stat").rpartition(b")")[2].split()[:1] == [b"T"]


def told(pid: int, name: str) -> bytes:
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


# For a process to say that it is there.
_START_SECONDS: Final = 60.0

# Between two looks at a process that is waited for, and between two when it has little left.
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


class UnwantedError(Exception):
    """Nobody waits for the answer any more."""


class WorkerProcess:
    """One worker process, and the socket that leads to it.

    Parameters
    ----------
    memory_bytes : int
        Its address space.
    is_batch : bool
        Whether it leaves a core to what wakes up.

    Raises
    ------
    ProcessLostError
        If it cannot be begun.
    """

    def __init__(self, memory_bytes: int, *, is_batch: bool = False) -> None:
        self._limit(_START_SECONDS)
        self._socket, theirs = socket.socketpair()
        self.pid = 0
        try:
            with theirs:
                self.pid = FORKS.fork(theirs, memory_bytes, is_batch)
            self._socket.setblocking(False)
            self._receive(self._receive_length())
        except (OSError, ValueError, DeadlineError, ProcessLostError) as error:
            self.end()
            raise ProcessLostError(f"no process: {type(error).__name__}: {error}") from error

    @property
    def is_alive(self) -> bool:
        """Whether its end of the socket is open."""
        return self._said() != b""

    @property
    def is_idle(self) -> bool:
        """Whether it is alive and has said nothing that would be taken for the next answer."""
        return self._said() is None

    @property
    def is_stopped(self) -> bool:
        """Whether a signal has stopped it or its parser: it will do nothing until another one."""
        return any(map(is_stopped, (self.pid, *_children(self.pid))))

    def exchange(
        self,
        request: bytes,
        seconds: float,
        processor_seconds: float = math.inf,
        is_wanted: Callable[[], bool] = lambda: True,
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
        UnwantedError
            If nobody wants the answer any more.
        """
        self._limit(seconds, self._spent() + processor_seconds, is_wanted)
        left = memoryview(len(request).to_bytes(PREFIX, "little") + request)
        try:
            while left:
                self._wait(select.POLLOUT)
                left = left[self._socket.send(left) :]
            return self._receive(self._receive_length())
        except OSError as error:
            raise ProcessLostError("its connection broke") from error

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

    def _said(self) -> bytes | None:
        """Give the next byte, and leave it there; None if there is none yet, b"" if none comes."""
        try:
            return self._socket.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return None
        except OSError:
            return b""

    def _spent(self) -> float:
        """Processor time that it and its parsers have taken so far, in s."""
        living = sum(map(_processor_clock, (self.pid, *_children(self.pid))))
        return living + _spent_by_children(self.pid)

    def _limit(
        self,
        seconds: float,
        most_clock: float = math.inf,
        is_wanted: Callable[[], bool] = lambda: True,
    ) -> None:
        self._deadline = time.monotonic() + seconds
        self._most_clock, self._is_wanted = most_clock, is_wanted

    def _receive_length(self) -> int:
        return int.from_bytes(self._receive(PREFIX), "little")

    def _receive(self, length: int) -> bytes:
        data = bytearray()
        while len(data) < length:
            self._wait(select.POLLIN)
            piece = self._socket.recv(min(_PIECE, length - len(data)))
            if not piece:
                raise ProcessLostError("it ended")
            data += piece
        return bytes(data)

    def _wait(self, event: int) -> None:
        poll = select.poll()
        poll.register(self._socket, event)
        was_stopped, next_look = False, _LOOK_SECONDS
        while (left := self._deadline - time.monotonic()) > 0:
            if poll.poll(1e3 * min(left, next_look)):
                return
            if not self._is_wanted():
                raise UnwantedError
            # Seen twice: whoever stops a process for a moment only looks at it.
            if (is_stopped_now := self.is_stopped) and was_stopped:
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


def serve(place: int) -> None:
    """Fork workers until the process that asks for them ends: what runs in the fork server."""
    # The server decides when its workers end, not a Ctrl-C that reaches the whole group.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nowhere, 0)
    os.close(nowhere)
    for name in PRELOADED:
        import_module(name)
    from modalmotion_service.work.worker import work

    # What workers share with this process stays shared.
    gc.collect()
    gc.freeze()
    control = socket.socket(fileno=place)
    codes: dict[int, int] = {}
    while True:
        word, places, *_ = socket.recv_fds(control, _LONGEST, 1)
        if not word:
            os._exit(0)
        answer: Any = None
        if places:
            try:
                answer = os.fork()
            except OSError as error:
                answer = -(error.errno or 1)
            if not answer:
                control.close()
                try:
                    work(socket.socket(fileno=places[0]), *json.loads(word))
                finally:
                    os._exit(1)
            os.close(places[0])
            _reap(codes)
        else:
            pid, end = int(word), time.monotonic() + _REAPING_SECONDS
            while pid not in codes and _reap(codes) and time.monotonic() < end:
                time.sleep(0.01)
            answer = codes.pop(pid, None)
        control.sendall(json.dumps(answer).encode())


def _reap(codes: dict[int, int]) -> bool:
    """Note how workers have ended; false where there are none."""
    if len(codes) > 1000:
        codes.clear()
    with contextlib.suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            codes[ended[0]] = os.waitstatus_to_exitcode(ended[1])
        return True
    return False
