"""Processes of their own for parsers that damaged files can crash.

The libraries of HDF5 and of images end the whole process, or take all memory, on some files. In a
`ParserProcess` they run in a child that is limited in memory and time, confined to Python and its
packages, and has nothing but the bytes that it is sent. Files of another sender get another child:
one that takes over its parser then reaches no file but those after it of the same sender.
"""

import atexit
import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import threading
from dataclasses import asdict
from functools import cache
from typing import Any, Final, Self

import numpy as np

from modalmotion import errors
from modalmotion.errors import InputError, LimitError, MalformedFileError, StoreError
from modalmotion.formats import parser_child, result
from modalmotion.limits import ReadLimits

_LONGEST_HEADER: Final = 1 << 24

# Ends of a parser that no file is to blame for: the system wants its memory, or an operator.
_FROM_OUTSIDE: Final = (-signal.SIGKILL, parser_child.UNCONFINED)
# Between the end of a pipe and that of its process.
_ENDING_SECONDS: Final = 5.0


class ParserLostError(MalformedFileError):
    """A parser was ended from outside: its file may be as it should be."""


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
            # Not until its answer ends: what it has forked itself may hold the pipe.
            with contextlib.suppress(BrokenPipeError), self._child:
                self._child.kill()
            self._child = None

    def parse(self, task: str, data: bytes) -> result.Answer:
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
        ParserLostError
            If it was ended from outside.
        LimitError
            If it took longer than `seconds`, or more memory than the limits allow for.
        StoreError
            If the system has no process left for the child.
        """
        if self._child is not None and self._child.poll() is not None:
            # Ended from outside since the last file, which this one is not to blame for.
            self.close()
        is_late = threading.Event()

        def end() -> None:
            is_late.set()
            child.kill()

        try:
            child = self._child = self._child or _start()
            clock = threading.Timer(self._seconds, end)
            clock.start()
        except (OSError, RuntimeError) as error:
            # RuntimeError: a thread could not be started.
            raise StoreError(
                f"The reader of this format could not be started ({error}).",
                remedy="The system has no process or memory left for it: try again when fewer "
                "run, or raise their number (ulimit -u, or pids_limit of a container).",
            ) from error
        try:
            _send(child.stdin, task, data, self.limits, self._seconds)
            answer = _receive(child.stdout, self.limits)
        except Exception as error:
            # Whatever an answer raises that is not one, or none.
            if isinstance(error, EOFError | OSError):
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.wait(_ENDING_SECONDS)
            ended = child.poll()
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
            if ended in _FROM_OUTSIDE:
                raise ParserLostError(
                    "The reader of this format was ended from outside.",
                    remedy="Send the file again; if that happens again, a smaller one.",
                ) from None
            raise MalformedFileError(
                "The reader of this format crashed on the file: it is damaged, or declares "
                "more than it contains.",
                remedy="Write the file anew, or send another format.",
            ) from None
        finally:
            clock.cancel()
        if isinstance(answer, InputError):
            raise answer
        return answer


@cache
def _kept_parser(_process: int, _thread: int, limits: ReadLimits) -> ParserProcess:
    parser = ParserProcess(limits)
    atexit.register(parser.close)
    return parser


def parser_of_thread(limits: ReadLimits) -> ParserProcess:
    """Give the parser that this thread reads one file after another with.

    It saves the half second in which a parser starts, and ends with the process. Only for files
    of one sender: one that takes over its parser reaches those after it.
    """
    # A fork of this process has its own: of one parser both would read the other's answers.
    return _kept_parser(os.getpid(), threading.get_ident(), limits)


def _send(stream: Any, task: str, data: bytes, limits: ReadLimits, seconds: float) -> None:
    """Send a file to a parser, which ends after about so much processor time."""
    most = {name: int(value) for name, value in asdict(limits).items()}
    request = {"task": task, "bytes": len(data), "limits": most, "seconds": seconds}
    header = json.dumps(request).encode()
    stream.write(len(header).to_bytes(8, "little"))
    stream.write(header)
    stream.write(data)
    stream.flush()


def _receive(stream: Any, limits: ReadLimits) -> result.Answer | InputError:
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
        limits.require(decompressed_bytes=n_bytes)
        array = np.empty(shape, kind)
        if array.size and stream.readinto(array.reshape(-1).view(np.uint8).data) != array.nbytes:
            raise EOFError(name)
        # Nobody copies what cannot change.
        array.setflags(write=False)
        arrays[name] = array.transpose(np.argsort(axes))
    return result.Answer(info, arrays) if header["error"] is None else _rebuilt(header["error"])


def _start() -> subprocess.Popen[bytes]:
    # -P: the working folder contains no modules of ours. No input is part of the command.
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "modalmotion.formats.parser_child"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


def _exactly(stream: Any, n_bytes: int) -> bytes:
    data: bytes = stream.read(n_bytes)
    if len(data) != n_bytes:
        raise EOFError
    return data


def _rebuilt(state: dict[str, Any]) -> InputError:
    kind: Any = getattr(errors, str(state.pop("kind")), None)
    is_ours = isinstance(kind, type) and issubclass(kind, InputError)
    made: InputError = (kind if is_ours else MalformedFileError)(state.pop("message"), **state)
    return made
