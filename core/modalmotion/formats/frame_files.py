"""Sequences of several files, in a folder, by a pattern of names or in a zip archive."""

from __future__ import annotations

import io
import stat
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Final

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.formats.detect import CONVERT, OF_IMAGES
from modalmotion.formats.frame import TRACK
from modalmotion.formats.frame_lists import (
    FRAME_SUFFIXES,
    SERIES_SUFFIXES,
    is_hidden,
    list_frames,
    name_beside,
    require_safe_name,
    write_series,
)
from modalmotion.formats.frames import read_frames
from modalmotion.formats.npz import UNREADABLE, member_content
from modalmotion.formats.ply import write_ply
from modalmotion.formats.result import Parser, ParserOfFile, Reading
from modalmotion.formats.xdmf import XDMF_SUFFIXES, read_xdmf
from modalmotion.limits import TEXT_UNFOLDING, ReadLimits
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress
from modalmotion.representation import counted

LISTS: Final = (*SERIES_SUFFIXES, *XDMF_SUFFIXES)
"""Ends of the names of files that name others."""

_MESHES: Final = (".msh", ".inp", ".bdf", ".nas", ".mesh", ".med", ".e", ".exo", ".su2", ".unv")
_IMAGE_ENDS: Final = (".nii", ".gz", ".nrrd", ".mha", ".dcm")
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
    found = read_frames(listing.names, read, parser, listing.times, progress)
    notes, ignored = (*found.notes, *listing.notes), (*found.ignored, *listing.others)
    return replace(found, notes=notes, ignored=ignored)


def _no_frames(names: list[str]) -> MalformedFileError:
    ends = Counter(PurePosixPath(name).suffix.lower() or "no ending" for name in names)
    seen = ", ".join(f"{n} {end}" for end, n in ends.most_common(4))
    remedy = f"Send files that end in {', '.join(FRAME_SUFFIXES)}."
    if ends.keys() & {*_MESHES}:
        remedy = CONVERT
    elif ends.keys() & {*_IMAGE_ENDS}:
        remedy = OF_IMAGES
    elif ends.keys() & {*_POINTS}:
        remedy = f"Clouds and contours are for {TRACK}."
    return MalformedFileError(
        f"There are no frames among {counted(len(names), 'file')}{f' ({seen})' if seen else ''}.",
        remedy=remedy,
    )


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


# Besides frames an archive may contain textures, notes and the like.
_MEMBERS_PER_FRAME: Final = 4
# Text that any archive may hold, however small: a second's reading.
_SMALLEST_TEXT: Final = 8_000_000
_ENCRYPTED: Final = 0x1
_KNOWN: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_REMEDY: Final = "Pack the frames again as a plain .zip."
# The earliest date that a zip can state: the same content makes the same bytes.
_NO_DATE: Final = (1980, 1, 1, 0, 0, 0)


def read_zip(data: bytes, parser: Parser, progress: Progress | None = None) -> Reading:
    """Read a sequence from a zip of frames.

    Frames come in the natural order of the numbers in their names, or as one .pvd or .series
    file in the archive lists them with their times. Nothing is unpacked to a disk.

    Parameters
    ----------
    data : bytes
    parser : Parser
        Its limits apply; `decompressed_bytes` for all members together.
    progress : callable, optional

    Raises
    ------
    MalformedFileError
        If it is not a readable archive, or contains links or names that lead out of it.
    LimitError
        If its members declare more than the limits accept.
    InputError
        If the frames do not form a sequence; frame and file are named.
    """
    with opened(data, parser) as archive:
        members, parser = archive.members, archive.parser
        # A list may name one frame many times.
        sizes = {name: member.n_bytes for name, member in members.items()}
        return read_files(list(members), lambda name: members[name].read(), parser, progress, sizes)


@dataclass(frozen=True)
class Member:
    """A file in an archive.

    Parameters
    ----------
    read : callable
        Returns the bytes.
    n_bytes : int
        That it declares; no more are read.
    """

    read: Callable[[], bytes]
    n_bytes: int


@dataclass(frozen=True)
class OpenArchive:
    """An archive whose declared sizes and names have been checked.

    Parameters
    ----------
    members : dict of str to Member
    parser : Parser
        For what is inside, with the limits on an archive of that size.
    """

    members: dict[str, Member]
    parser: Parser


@contextmanager
def opened(data: bytes, parser: Parser) -> Iterator[OpenArchive]:
    """Open a zip and check what it declares before anything is read; see `read_zip`."""
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except UNREADABLE as error:
        raise MalformedFileError(
            f"These {len(data)} bytes are not a readable .zip (the file may be cut short).",
            remedy=_REMEDY,
        ) from error
    limits = parser.limits.of_file(len(data), TEXT_UNFOLDING, _SMALLEST_TEXT)
    with archive:
        infos = _plain_members(archive, limits)
        members = {
            name: Member(partial(_content, archive, info), info.file_size)
            for name, info in infos.items()
        }
        yield OpenArchive(members, ParserOfFile(parser, limits))


def write_ply_zip(sequence: MeshSequence) -> bytes:
    """Write a sequence as a zip of binary PLY files, with a .series file for ParaView.

    Returns
    -------
    bytes
        `read_zip` reads it back with the same positions, faces, times and unit.
    """
    grid, topology = sequence.grid, sequence.topology
    stated = {
        "unit": sequence.unit,
        "topology": None if topology is None else topology.name,
        "grid": None if grid is None else " ".join(map(str, grid)),
    }
    statements = {name: value for name, value in stated.items() if value is not None}
    width = max(4, len(str(sequence.n_frames - 1)))
    names = [f"frame_{i:0{width}d}.ply" for i in range(sequence.n_frames)]
    files = {
        name: write_ply(positions, sequence.faces, statements)
        for name, positions in zip(names, sequence.vertices, strict=True)
    }
    if sequence.times is not None:
        files["frames.ply.series"] = write_series(names, sequence.times.tolist())
    return stored_zip(files, zipfile.ZIP_DEFLATED)


def stored_zip(files: Mapping[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    """Write files as a zip, the same bytes for the same files."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name, _NO_DATE), data, compress_type=compression)
    return buffer.getvalue()


def _plain_members(archive: zipfile.ZipFile, limits: ReadLimits) -> dict[str, zipfile.ZipInfo]:
    members: dict[str, zipfile.ZipInfo] = {}
    infos = archive.infolist()
    most = _MEMBERS_PER_FRAME * limits.frames
    if len(infos) > most:
        raise LimitError(
            f"The archive contains {len(infos)} members; at most {most} are accepted.",
            remedy="Send fewer frames.",
            limit="frames",
            details={"value": len(infos), "most": most},
        )
    for info in infos:
        # The name as it is in the archive, before Python turns separators around.
        require_safe_name(info.orig_filename)
        if info.filename.endswith("/"):
            continue
        for is_so, what in (
            (not info.filename, "without a name"),
            (stat.S_ISLNK(info.external_attr >> 16), "a link"),
            (info.flag_bits & _ENCRYPTED, "encrypted"),
            (info.compress_type not in _KNOWN, "compressed in another way than 'deflate'"),
            (info.filename in members, "there twice"),
        ):
            if is_so:
                raise MalformedFileError(
                    f"The member {info.filename[-60:]!r} of the archive is {what}.",
                    remedy=_REMEDY,
                    details={"name": info.filename[-200:]},
                )
        members[info.filename] = info
    limits.require("decompressed_bytes", sum(info.file_size for info in members.values()))
    return members


def _content(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    try:
        return member_content(archive, info).tobytes()
    except UNREADABLE as error:
        raise MalformedFileError(
            f"The member {info.filename[-60:]!r} of the archive is damaged ({str(error)[:80]}).",
            remedy="Send the file again, or pack it anew.",
        ) from error
    except MalformedFileError as error:
        error.message = f"The member {info.filename[-60:]!r}: {error.message}"
        raise
