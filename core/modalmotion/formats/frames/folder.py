"""A folder, or a pattern of names, of frames on this machine."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frames.frames import FrameFile, read_frames
from modalmotion.formats.frames.listing import list_frames
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.result import Reading
from modalmotion.progress import Progress

_WILD = frozenset("*?[")


def is_pattern(path: Path) -> bool:
    """Tell whether a path is a pattern of names such as scan_*.ply."""
    return bool(_WILD & set(path.name))


def read_folder(path: Path, parser: Parser, progress: Progress | None = None) -> Reading:
    """Read a sequence from the files in a folder, or from those that fit a pattern.

    Frames come in the natural order of the numbers in their names, or as one .pvd or .series
    file among them lists them.

    Parameters
    ----------
    path : Path
        A folder, or a folder and a pattern of names (*, ?, [...]).
    parser : Parser
        Its limits hold.
    progress : callable, optional

    Raises
    ------
    MalformedFileError
        If nothing there is a frame, or a file cannot be read.
    InputError
        If the frames make no sequence; frame and file are named.
    """
    folder, pattern = (path, "*") if path.is_dir() else (path.parent, path.name)
    paths = {file.name: file for file in folder.glob(pattern) if file.is_file()}
    if path.is_dir():
        # A list of frames may name those in folders beneath it.
        paths |= {
            file.relative_to(folder).as_posix(): file
            for file in folder.glob("*/*")
            if file.is_file() and any(name.endswith((".pvd", ".series")) for name in paths)
        }

    def read(name: str) -> bytes:
        try:
            return paths[name].read_bytes()
        except OSError as error:
            raise MalformedFileError(
                f"{name!r} cannot be read: {error.strerror}.", remedy="Check its permissions."
            ) from error

    listing = list_frames(list(paths), read, parser.limits)
    files = [FrameFile(name, partial(read, name)) for name in listing.names]
    return listing.complete(read_frames(files, parser, listing.times, progress))
