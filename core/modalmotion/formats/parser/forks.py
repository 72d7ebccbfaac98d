"""Parsers that are forked, confined, and soon gone.

For a process that serves many people and may be lost, such as a worker of the service. What a
file makes of its parser reaches nobody else's: the parser sees Python and its packages alone,
inherits the memory of a process that has read nothing, and ends when it is told to, before the
next one's file. Beside a `ParserProcess` it saves the second in which that starts.
"""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import socket
from collections.abc import Callable
from functools import partial
from typing import Final, NoReturn

from modalmotion.errors import InputError
from modalmotion.formats.parser.answer import Answer
from modalmotion.formats.parser.child import answer_next
from modalmotion.formats.parser.confinement import confine, end_with, landlock_version
from modalmotion.formats.parser.process import BROKEN, broke_down, receive, send
from modalmotion.formats.parser.registry import prepare
from modalmotion.limits import ReadLimits

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
            Name of a parser in `parser.registry`.
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
        except BROKEN as error:
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
