"""`python -m modalmotion ...` forked from a process that has imported what it will import.

To import the service and what its workers need takes some 3 s of processor time, which a test of
a service that is already there has no use for. The forked process is as if started anew: its own
arguments, environment, folder, output and session, nothing opened, one thread.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import importlib
import json
import os
import resource
import runpy
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import IO, Any, Final

from modalmotion_service.work.forks import PRELOADED

_SERVER: Final = [
    *("modalmotion.cli", "modalmotion_service.commands.serve"),
    *("modalmotion_service.commands.server", "uvicorn.lifespan.on", "uvicorn.loops.asyncio"),
    *("uvicorn.protocols.http.h11_impl", "concurrent.futures.thread"),
    "made_routes",
]
_CLUSTER: Final = [
    *("modalmotion.cli", "modalmotion_service.work.dask_engine", "distributed.scheduler"),
    *("distributed.worker", "distributed.client", "distributed.comm.tcp", "distributed.dashboard"),
    "distributed.cli.dask_worker",
]

# Where no other file of a process is.
_HIGH: Final = 200
_MOST_BYTES: Final = 150_000
_MOST_FILES: Final = 10


class WarmProcess:
    """A forked process, used as a `subprocess.Popen`."""

    def __init__(self, pid: int, start: _WarmStart) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._start = start

    def poll(self) -> int | None:
        """Code that it ended with, negative for a signal; None while it runs."""
        if self.returncode is None:
            self.returncode = self._start.ended(self.pid)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired("a warm process", timeout or 0.0)
            time.sleep(0.01)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it."""
        self.send_signal(signal.SIGKILL)


class _WarmStart:
    """The process that has imported everything, as seen by the tests."""

    def __init__(self, modules: Sequence[str], flags: Sequence[str]) -> None:
        self._lock = threading.Lock()
        self._codes: dict[int, int] = {}
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
            program = f"import warm_start; warm_start.fork_for_ever({theirs.fileno()}, {modules})()"
            self._process = subprocess.Popen(
                [sys.executable, *flags, "-c", program],
                env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
                pass_fds=[theirs.fileno()],
            )
        atexit.register(self._end)

    def _end(self) -> None:
        self._socket.close()
        self._process.wait()

    def process(
        self,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        folder: Path,
        sink: IO[bytes],
        is_session: bool,
        passed: Sequence[int],
        most_files: int,
    ) -> WarmProcess:
        request = {
            "arguments": list(arguments),
            "environment": dict(environment),
            "folder": str(folder),
            "is_session": is_session,
            "names": list(passed),
            "most_files": most_files,
        }
        with self._lock:
            socket.send_fds(self._socket, [json.dumps(request).encode()], [sink.fileno(), *passed])
            while "pid" not in (answer := self._answer()):
                pass
        return WarmProcess(answer["pid"], self)

    def ended(self, pid: int) -> int | None:
        with self._lock:
            self._socket.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while pid not in self._codes:
                    self._answer()
            self._socket.setblocking(True)
            return self._codes.get(pid)

    def _answer(self) -> dict[str, int]:
        data = self._socket.recv(_MOST_BYTES)
        assert data, f"the warm process ended with {self._process.wait()}"
        answer: dict[str, int] = json.loads(data)
        if "ended" in answer:
            self._codes[answer["ended"]] = answer["code"]
        return answer


@cache
def _warm_start(kind: str) -> _WarmStart:
    if kind == "server":
        return _WarmStart([*_SERVER, *PRELOADED], ["-W", "error"])
    return _WarmStart([*_CLUSTER, *PRELOADED], [])


def start_warm(
    kind: str,
    *arguments: str,
    environment: Mapping[str, str],
    folder: Path,
    sink: IO[bytes],
    is_session: bool = False,
    passed: Sequence[int] = (),
    most_files: int = 0,
) -> WarmProcess:
    """Start `python -m arguments`; a server's warnings are errors.

    Parameters
    ----------
    kind : str
        What it will import: that of a "server" or that of a "cluster".
    arguments : str
        A module, and its arguments.
    environment : mapping
        All of it.
    folder : Path
        It works there.
    sink : file
        Takes its output and its errors.
    is_session : bool
        Whether it has a session of its own.
    passed : sequence of int
        Open files that it has under the same numbers.
    most_files : int
        What it may open at most, unless that is 0.
    """
    return _warm_start(kind).process(
        arguments, environment, folder, sink, is_session, passed, most_files
    )


# What follows runs in the warm process.


def fork_for_ever(connection: int, modules: Sequence[str]) -> Callable[[], None]:
    """Import modules, then fork for whoever asks; in the forked one give what it is to do."""
    for name in modules:
        importlib.import_module(name)
    # A fork takes one thread along, and whatever locks the others hold.
    assert len(list(Path("/proc/self/task").iterdir())) == 1
    link = socket.socket(fileno=connection)
    running: dict[int, int] = {}
    selector = selectors.DefaultSelector()
    selector.register(link, selectors.EVENT_READ)
    while True:
        for key, _ in selector.select():
            if key.fd in running:
                selector.unregister(key.fd)
                os.close(key.fd)
                pid = running.pop(key.fd)
                code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                with contextlib.suppress(OSError):
                    link.send(json.dumps({"ended": pid, "code": code}).encode())
                continue
            data, received, *_ = socket.recv_fds(link, _MOST_BYTES, _MOST_FILES)
            if not data:
                sys.exit()
            if (pid := os.fork()) == 0:
                selector.close()
                link.close()
                for watch in running:
                    os.close(watch)
                return _as_anew(json.loads(data), *received)
            for number in received:
                os.close(number)
            watch = os.pidfd_open(pid)
            running[watch] = pid
            selector.register(watch, selectors.EVENT_READ)
            link.send(json.dumps({"pid": pid}).encode())


def _as_anew(request: dict[str, Any], output: int, *passed: int) -> Callable[[], None]:
    if request["is_session"]:
        os.setsid()
    for number in (1, 2):
        os.dup2(output, number)
    os.close(output)
    _under_their_numbers(passed, request["names"])
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    if most := request["most_files"]:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    module, *rest = request["arguments"]

    def run() -> None:
        sys.argv = [module, *rest]
        runpy.run_module(module, run_name="__main__", alter_sys=True)

    return run


def _under_their_numbers(received: Sequence[int], names: Sequence[int]) -> None:
    """Have open files under the numbers that a program names."""
    high = [fcntl.fcntl(number, fcntl.F_DUPFD, _HIGH) for number in received]
    for number in received:
        os.close(number)
    for number, name in zip(high, names, strict=True):
        os.dup2(number, name)
        os.close(number)
