"""Processes of their own for parsers that damaged files can crash.

The libraries of HDF5 and of images end the whole process, or take all memory, on some files. In a
`ParserProcess` they run in a child that is limited in memory and time, reads only the bytes it is
sent, and whose end is an error like any other.

`ParserForks` is for a process that serves many people and may be lost, such as a worker of the
service. It saves the second in which a `ParserProcess` starts. A parser sees Python and its
packages alone, inherits the memory of a process that has read nothing, and ends when it is told
to, before the next one's file; so a file that takes over its parser reaches no other file.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import json
import math
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from typing import IO, Any, Final, NoReturn, Self

import numpy as np

from modalmotion import errors
from modalmotion.errors import InputError, LimitError, MalformedFileError, StoreError
from modalmotion.formats.parser_child import (
    answer_next,
    confine,
    end_with,
    landlock_version,
    prepare,
)
from modalmotion.formats.result import Answer
from modalmotion.limits import ReadLimits

_LONGEST_HEADER: Final = 1 << 24


class ParserProcess:
    """A child process for parsers, started at the first file and again after it ended.

    Use one for many files, from one thread at a time; leaving its `with` block ends it.

    Parameters
    ----------
    limits : ReadLimits
    seconds : float
        Longest time for one file.
    """

    def __init__(self, limits: ReadLimits, seconds: float = 60.0) -> None:
        self.limits = limits
        self._seconds = seconds
        self._child: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the child, if it runs."""
        if self._child is not None:
            self._child.kill()
            self._child.communicate()
            self._child = None

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file in the child.

        Parameters
        ----------
        task : str
            Name of a parser in `parser_child`.
        data : bytes

        Raises
        ------
        InputError
            What the parser raised, or MalformedFileError if it ended on this file.
        LimitError
            If it took longer than `seconds`, or more memory than the limits allow for.
        """
        if self._child is not None and self._child.poll() is not None:
            # Ended from outside since the last file, which this one is not to blame for.
            self.close()
        if self._child is None:
            self._child = _start()
        child = self._child
        if child.stdin is None or child.stdout is None:
            raise StoreError("The parser's process has no pipes.", remedy="Start it again.")
        try:
            with _killed_after(self._seconds, child) as is_late:
                send(child.stdin, task, data, self.limits, self._seconds)
                answer = receive(child.stdout, self.limits)
        except Exception as error:
            # Whatever an answer raises that is not one, or none.
            self.close()
            if isinstance(error, InputError):
                raise
            if is_late.is_set():
                raise LimitError(
                    f"Reading the file took longer than {self._seconds:g} s.",
                    remedy="Send fewer frames or a coarser mesh, or another format.",
                    limit="parser_seconds",
                    details={"most": self._seconds},
                ) from None
            raise broke_down() from None
        if isinstance(answer, InputError):
            raise answer
        return answer


class _OfThread(threading.local):
    """What each thread has for itself."""

    def __init__(self) -> None:
        self.parsers: dict[tuple[int, ReadLimits], ParserProcess] = {}


_of_thread: Final = _OfThread()


def parser_of_thread(limits: ReadLimits) -> ParserProcess:
    """Give the parser that this thread reads one file after another with.

    It saves the half second in which a parser starts, and ends with the process. Only for files
    of one sender: one that takes over its parser reaches those after it.
    """
    # A fork of this process has its own: of one parser both would read the other's answers.
    own = os.getpid(), limits
    if own not in _of_thread.parsers:
        _of_thread.parsers[own] = ParserProcess(limits)
        atexit.register(_of_thread.parsers[own].close)
    return _of_thread.parsers[own]


def broke_down() -> MalformedFileError:
    """Make the error for a file that its parser did not outlive."""
    return MalformedFileError(
        "The reader of this format crashed on the file: it is damaged, or declares "
        "more than it contains.",
        remedy="Write the file anew, or send another format.",
    )


def send(
    stream: IO[bytes], task: str, data: bytes, limits: ReadLimits, seconds: float | None = None
) -> None:
    """Send a file to a parser.

    Parameters
    ----------
    stream : file
    task : str
    data : bytes
    limits : ReadLimits
    seconds : float, optional
        Processor time after which it ends, roughly.
    """
    most = {name: int(value) for name, value in asdict(limits).items()}
    request = {"task": task, "bytes": len(data), "limits": most, "seconds": seconds}
    header = json.dumps(request).encode()
    stream.write(len(header).to_bytes(8, "little"))
    stream.write(header)
    stream.write(data)
    stream.flush()


def receive(stream: Any, limits: ReadLimits) -> Answer | InputError:
    """Receive what a parser answers: arrays, or what is wrong with the file.

    Raises
    ------
    InputError
        If it answers more than `limits` allow for.
    Exception
        Of any kind, if it ends, or what it answers is not an answer.
    """
    length = int.from_bytes(_exactly(stream, 8), "little")
    if length > _LONGEST_HEADER:
        raise ValueError(length)
    header = json.loads(_exactly(stream, length))
    info, arrays, n_bytes = dict(header["info"]), {}, 0
    for name, dtype, shape, axes in header["arrays"]:
        kind = np.dtype(dtype)
        if kind.kind not in "fiu":
            raise ValueError(dtype)
        n_bytes += math.prod(shape) * kind.itemsize
        limits.require("decompressed_bytes", n_bytes)
        array = np.empty(shape, kind)
        if array.size and stream.readinto(array.reshape(-1).view(np.uint8).data) != array.nbytes:
            raise EOFError(name)
        # Nobody copies what cannot change.
        array.setflags(write=False)
        arrays[name] = array.transpose(np.argsort(axes))
    return Answer(info, arrays) if header["error"] is None else _rebuilt(header["error"])


def _start() -> subprocess.Popen[bytes]:
    # -P: the working folder contains no modules of ours. No input is part of the command.
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "modalmotion.formats.parser_child"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


@contextmanager
def _killed_after(seconds: float, child: subprocess.Popen[bytes]) -> Iterator[threading.Event]:
    is_late = threading.Event()

    def kill() -> None:
        is_late.set()
        child.kill()

    timer = threading.Timer(seconds, kill)
    timer.start()
    try:
        yield is_late
    finally:
        timer.cancel()


def _exactly(stream: IO[bytes], n_bytes: int) -> bytes:
    data = stream.read(n_bytes)
    if len(data) != n_bytes:
        raise EOFError
    return data


def _rebuilt(state: dict[str, Any]) -> InputError:
    kind: Any = getattr(errors, str(state.pop("kind")), None)
    is_ours = isinstance(kind, type) and issubclass(kind, InputError)
    made: InputError = (kind if is_ours else MalformedFileError)(state.pop("message"), **state)
    return made


# How a parser ended, as a signed number of so many bytes; negative for a signal.
_STATUS_BYTES: Final = 4
# Of a parser that could not be confined where the system can.
_UNCONFINED: Final = 77
# Which no file is to blame for.
_FROM_OUTSIDE: Final = (-signal.SIGKILL, _UNCONFINED)
_LONGEST_NAME: Final = 64


class ParserLostError(Exception):
    """The process that forks parsers has ended, or a parser was ended from outside."""


class ParserForks:
    """The process that forks parsers, one at a time; it ends with the one that made it.

    Make it before the process has read anything of anybody, or has threads; use it from one
    thread at a time.

    Attributes
    ----------
    pid : int
    """

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        parent = os.getpid()
        self.pid = os.fork()
        if not self.pid:
            _in_child(partial(_serve, theirs, parent))
        theirs.close()
        self._control = ours
        self._parser: socket.socket | None = None

    def close(self) -> None:
        """End it."""
        if self._parser is not None:
            self._parser.close()
        self._control.close()
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self.pid, 0)

    def parse(self, task: str, data: bytes, limits: ReadLimits) -> Answer:
        """Parse a file in the parser that lives, or in a new one.

        Parameters
        ----------
        task : str
            Name of a parser in `parser_child`.
        data : bytes
        limits : ReadLimits

        Raises
        ------
        InputError
            What the parser raised, or MalformedFileError if it ended on this file.
        ParserLostError
            If it was ended from outside, or cannot be begun.
        """
        if self._parser is None:
            self._parser = self._begun(task)
        try:
            with self._parser.makefile("wb") as sink:
                send(sink, task, data, limits)
            with self._parser.makefile("rb") as source:
                answer = receive(source, limits)
        except Exception as error:  # noqa: BLE001 - as of `receive`
            self.end_parser()
            raise (error if isinstance(error, InputError) else broke_down()) from None
        if isinstance(answer, InputError):
            raise answer
        return answer

    def end_parser(self) -> None:
        """End the parser that lives, if one does: the next file is another one's.

        Raises
        ------
        ParserLostError
            If it was ended from outside.
        """
        if self._parser is None:
            return
        self._parser.close()
        self._parser = None
        status = b""
        with contextlib.suppress(OSError):
            status = self._control.recv(_STATUS_BYTES, socket.MSG_WAITALL)
        if len(status) < _STATUS_BYTES:
            raise ParserLostError("the process that forks parsers has ended")
        # Killed by the system, which wants its memory, or by an operator.
        if (code := int.from_bytes(status, "little", signed=True)) in _FROM_OUTSIDE:
            raise ParserLostError(f"a parser was ended from outside: {code}")

    def _begun(self, task: str) -> socket.socket:
        ours, theirs = socket.socketpair()
        with theirs:
            try:
                socket.send_fds(self._control, [task.encode()], [theirs.fileno()])
            except OSError as error:
                ours.close()
                raise ParserLostError("the process that forks parsers has ended") from error
        return ours


def _in_child(work: Callable[[], object]) -> NoReturn:
    """Do what a forked process is for, and end it: nothing of its parent's is cleaned up twice."""
    status = 1
    try:
        work()
        status = 0
    finally:
        os._exit(status)


def _serve(control: socket.socket, parent: int) -> None:
    """Fork a parser for each request until the socket closes."""
    end_with(parent)
    _keep_only(control)
    # What parsers share with this process stays shared.
    gc.freeze()
    server = os.getpid()
    while True:
        task, places, _, _ = socket.recv_fds(control, _LONGEST_NAME, 1)
        if not places:
            return
        # Imported once, and by a process that reads no file.
        prepare(task.decode())
        pid = os.fork()
        if not pid:
            _in_child(partial(_parse, control, places[0], server))
        os.close(places[0])
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        control.sendall(status.to_bytes(_STATUS_BYTES, "little", signed=True))


def _parse(control: socket.socket, place: int, server: int) -> None:
    """Parse files until nobody sends one: what runs in a parser."""
    end_with(server)
    control.close()
    # By itself: processes that are confined together may trace one another.
    if not confine() and landlock_version():
        os._exit(_UNCONFINED)
    connection = socket.socket(fileno=place)
    with connection, connection.makefile("rb") as source, connection.makefile("wb") as sink:
        while answer_next(source, sink):
            pass


def _keep_only(control: socket.socket) -> None:
    # Locks and sockets of the parent are its own, and libraries have nothing to print to.
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nowhere, number)
    os.closerange(3, control.fileno())
    os.closerange(control.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
