"""Frames in files of their own, read as one sequence."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from modalmotion.errors import InputError
from modalmotion.formats.frames.frame_stack import FrameStack
from modalmotion.formats.mesh_file import read_mesh
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.result import Reading
from modalmotion.progress import Progress


@dataclass(frozen=True)
class FrameFile:
    """A frame's file, not yet read.

    Parameters
    ----------
    name : str
    read : callable
        Returns the bytes.
    """

    name: str
    read: Callable[[], bytes]


def read_frames(
    files: list[FrameFile],
    parser: Parser,
    times: tuple[float, ...] | None = None,
    progress: Progress | None = None,
) -> Reading:
    """Read frames and join them to one sequence.

    Parameters
    ----------
    files : list of FrameFile
        In the order of time.
    parser : Parser
        Its limits apply.
    times : tuple of float, s, optional
    progress : callable, optional

    Raises
    ------
    InputError
        It names the frame and its file.
    """
    report = progress or (lambda _done, _all: None)
    parser.limits.require("frames", len(files))
    with _named(0, files[0].name):
        frame, kind = read_mesh(files[0].read(), None, parser)
        stack = FrameStack(frame, kind, len(files), parser.limits)
    report(1, len(files))
    for number, file in enumerate(files[1:], 1):
        with _named(number, file.name):
            stack.add(number, *read_mesh(file.read(), None, parser))
        report(number + 1, len(files))
    return stack.result(times)


@contextmanager
def _named(number: int, name: str) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise _in_frame(error, number, name) from error


def _in_frame(error: InputError, number: int, name: str) -> InputError:
    message = error.message.removeprefix(f"Frame {number}: ")
    return type(error)(
        f"Frame {number} ({name[-60:]!r}): {message}",
        remedy=error.remedy,
        frame=number,
        vertex=error.vertex,
        limit=error.limit,
        details={**error.details, "file": name[-200:]},
    )
