"""Frames in a local folder, or that match a pattern of names."""

from __future__ import annotations

from pathlib import Path

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frames.listed_files import LISTS, read_files
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.result import Reading
from modalmotion.progress import Progress

_WILD = frozenset("*?[")


def is_pattern(path: Path) -> bool:
    """Return whether a path is a pattern of names such as scan_*.ply."""
    return bool(_WILD & set(path.name))


def read_folder(path: Path, parser: Parser, progress: Progress | None = None) -> Reading:
    """Read a sequence from the files in a folder, or from those that match a pattern.

    Frames come in the natural order of the numbers in their names, or as one .pvd or .series
    file among them lists them.

    Parameters
    ----------
    path : Path
        A folder, a folder and a pattern of names (*, ?, [...]), or a list in its folder.
    parser : Parser
        Its limits apply.
    progress : callable, optional

    Raises
    ------
    MalformedFileError
        If no file is a frame, or a file cannot be read.
    InputError
        If the frames do not form a sequence; frame and file are named.
    """
    is_whole, is_list = path.is_dir(), path.is_file()
    folder, pattern = (path, "*") if is_whole else (path.parent, path.name)
    paths = {file.name: file for file in folder.glob("*" if is_list else pattern) if file.is_file()}
    if is_list:
        paths = {n: p for n, p in paths.items() if n == path.name or not n.lower().endswith(LISTS)}
    if is_list or is_whole:
        # A list of frames may name those in folders beneath it.
        paths |= {
            file.relative_to(folder).as_posix(): file
            for file in folder.glob("*/*")
            if file.is_file() and any(name.endswith(LISTS) for name in paths)
        }

    def read(name: str) -> bytes:
        try:
            return paths[name].read_bytes()
        except OSError as error:
            raise MalformedFileError(
                f"{name!r} cannot be read: {error.strerror}.", remedy="Check its permissions."
            ) from error

    return read_files(list(paths), read, parser, progress)
