"""The process that workers are forked from: it has imported what tasks need, and opened nothing.

A worker starts at once, and inherits no lock, socket or database connection. Nothing is believed of
this process: it has a deadline for every answer, and one that is stopped or gone is begun anew.
A server that starts imports what both need and forks it, before it opens anything itself.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import signal
import socket
import sys
import threading
import time
from importlib import import_module
from multiprocessing import util
from typing import Any, Final

# Of SciPy what the tasks use, which they import where they use it: a parser that is confined can
# open no file any more, and the first task is to be as quick as the next.
PRELOADED: Final = [
    *(f"scipy.{name}" for name in ("fft", "interpolate", "linalg", "ndimage", "optimize")),
    *("scipy.sparse.csgraph", "scipy.sparse.linalg", "scipy.spatial.transform", "scipy.special"),
    *(
        f"modalmotion_service.work.tasks.{name}"
        for name in ("sequences", "signatures", "derived", "classification", "tracks")
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

    def _end(self) -> None:
        if self._control is not None:
            self._control.close()
            self._control = None
            with contextlib.suppress(OSError):
                os.kill(self.pid, signal.SIGKILL)
                os.waitpid(self.pid, 0)
            self.pid = 0


FORKS: Final = Forks()
"""That of this process."""


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
