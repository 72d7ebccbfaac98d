"""A process of its own for parsers that damaged files can crash.

The HDF5 and VTK libraries end the whole process, or take all memory, on some files. They run
here in a child that is limited in memory and time, reads only the bytes it is sent, and
whose end is an error like any other.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import IO, Any, Final, Self

import numpy as np

from modalmotion import errors
from modalmotion.errors import InputError, LimitError, MalformedFileError, StoreError
from modalmotion.formats.parser.answer import Answer
from modalmotion.limits import ReadLimits

_LONGEST_HEADER: Final = 1 << 24

# What an answer that is not one, or none, may raise.
BROKEN: Final = (
    *(EOFError, OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError),
)


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
        self._limits = limits
        self._seconds = seconds
        self._child: subprocess.Popen[bytes] | None = None

    @property
    def limits(self) -> ReadLimits:
        """Limits on a file."""
        return self._limits

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
            Name of a parser in `parser.registry`.
        data : bytes

        Raises
        ------
        InputError
            What the parser raised, or MalformedFileError if it ended on this file.
        LimitError
            If it took longer than `seconds`, or more memory than the limits allow for.
        """
        if self._child is None:
            self._child = _start()
        child = self._child
        if child.stdin is None or child.stdout is None:
            raise StoreError("The parser's process has no pipes.", remedy="Start it again.")
        try:
            with _killed_after(self._seconds, child) as is_late:
                send(child.stdin, task, data, self.limits, self._seconds)
                answer = receive(child.stdout, self.limits)
        except BROKEN as error:
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


def broke_down() -> MalformedFileError:
    """Make the error for a file that its parser did not outlive."""
    return MalformedFileError(
        "The reader of this format broke down on the file: it is damaged, or declares "
        "more than it holds.",
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


def receive(stream: IO[bytes], limits: ReadLimits) -> Answer | InputError:
    """Receive what a parser answers: arrays, or what is wrong with the file.

    Raises
    ------
    InputError
        If it answers more than `limits` allow for.
    OSError, EOFError, ValueError, TypeError, KeyError, AttributeError, RecursionError
        If it ends, or what it answers is not an answer.
    """
    header = _receive_header(stream)
    answer = _receive_arrays(stream, header, limits)
    return answer if header["error"] is None else _rebuilt(header["error"])


def _start() -> subprocess.Popen[bytes]:
    # -P: the working folder contains no modules of ours. No input is part of the command.
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "modalmotion.formats.parser.child"],
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


def _receive_header(stream: IO[bytes]) -> dict[str, Any]:
    length = int.from_bytes(_exactly(stream, 8), "little")
    if length > _LONGEST_HEADER:
        raise ValueError(length)
    header = json.loads(_exactly(stream, length))
    return {"error": header["error"], "info": dict(header["info"]), "arrays": header["arrays"]}


def _receive_arrays(stream: Any, header: dict[str, Any], limits: ReadLimits) -> Answer:
    arrays = {}
    n_bytes = 0
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
    return Answer(header["info"], arrays)


def _exactly(stream: IO[bytes], n_bytes: int) -> bytes:
    data = stream.read(n_bytes)
    if len(data) != n_bytes:
        raise EOFError
    return data


def _rebuilt(state: dict[str, Any]) -> InputError:
    kind = getattr(errors, str(state.pop("kind")), MalformedFileError)
    if not (isinstance(kind, type) and issubclass(kind, InputError)):
        kind = MalformedFileError
    return kind(str(state.pop("message")), **state)
