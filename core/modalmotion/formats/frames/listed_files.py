"""A sequence from named files: frames, a list of frames, or XDMF with what it names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import PurePosixPath
from typing import Final

from modalmotion.errors import MalformedFileError
from modalmotion.formats.detect import CONVERT
from modalmotion.formats.frames.frame import TRACK
from modalmotion.formats.frames.frames import FrameFile, read_frames
from modalmotion.formats.frames.listing import list_frames
from modalmotion.formats.frames.names import (
    FRAME_SUFFIXES,
    SERIES_SUFFIXES,
    is_hidden,
    name_beside,
)
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.result import Reading
from modalmotion.formats.xdmf import XDMF_SUFFIXES, read_xdmf
from modalmotion.progress import Progress
from modalmotion.representation import counted

LISTS: Final = (*SERIES_SUFFIXES, *XDMF_SUFFIXES)
"""Ends of the names of files that name others."""

_MESHES: Final = (".msh", ".inp", ".bdf", ".nas", ".mesh", ".med", ".e", ".exo", ".su2", ".unv")
_POINTS: Final = (".csv", ".txt", ".xyz", ".pcd")


def read_files(
    names: list[str],
    read: Callable[[str], bytes],
    parser: Parser,
    progress: Progress | None = None,
    sizes: Mapping[str, int] | None = None,
) -> Reading:
    """Read a sequence from files.

    Parameters
    ----------
    names : list of str
    read : callable
        Returns the bytes of one of them.
    parser : Parser
        Its limits apply.
    progress : callable, optional
    sizes : mapping of str to int, optional
        Bytes of each, where reading unpacks them: those that are read are compared with the limits.

    Raises
    ------
    MalformedFileError
        If none is a frame; it says what they are.
    InputError
        If the frames do not form a sequence; frame and file are named.
    """
    visible = [name for name in names if not is_hidden(name)]
    grids = [name for name in visible if name.lower().endswith(XDMF_SUFFIXES)]
    if len(grids) == 1:
        there = set(visible)

        def beside(name: str) -> bytes:
            path = name_beside(grids[0], name)
            if path not in there:
                raise MalformedFileError(
                    f"{grids[0][-60:]!r} names {name[-60:]!r}, which is not there.",
                    remedy="Keep the two files together.",
                )
            return read(path)

        return read_xdmf(read(grids[0]), beside, parser)
    listing = list_frames(names, read, parser.limits)
    if not listing.names:
        raise _no_frames(visible)
    if sizes is not None:
        total = sum(sizes[name] for name in listing.names)
        parser.limits.require("decompressed_bytes", total)
    files = [FrameFile(name, partial(read, name)) for name in listing.names]
    return listing.complete(read_frames(files, parser, listing.times, progress))


def _no_frames(names: list[str]) -> MalformedFileError:
    ends = Counter(PurePosixPath(name).suffix.lower() or "no ending" for name in names)
    seen = ", ".join(f"{n} {end}" for end, n in ends.most_common(4))
    remedy = f"Send files that end in {', '.join(FRAME_SUFFIXES)}."
    if ends.keys() & {*_MESHES}:
        remedy = CONVERT
    elif ends.keys() & {*_POINTS}:
        remedy = f"Clouds and contours are for {TRACK}."
    return MalformedFileError(
        f"There are no frames among {counted(len(names), 'file')}{f' ({seen})' if seen else ''}.",
        remedy=remedy,
    )
