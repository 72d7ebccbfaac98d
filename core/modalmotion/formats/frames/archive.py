"""A zip of frames, in and out."""

from __future__ import annotations

import io
import stat
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Final

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.formats.frames.listed_files import read_files
from modalmotion.formats.frames.names import require_safe_name
from modalmotion.formats.frames.series import write_series
from modalmotion.formats.parser.answer import Parser, ParserOfFile
from modalmotion.formats.ply.ply import write_ply
from modalmotion.formats.result import Reading
from modalmotion.formats.zip_member import UNREADABLE, member_content
from modalmotion.limits import TEXT_UNFOLDING, ReadLimits
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress

# Besides frames an archive may contain textures, notes and the like.
_MEMBERS_PER_FRAME: Final = 4
# Text that any archive may hold, however small: a second's reading.
_SMALLEST_TEXT: Final = 8_000_000
_ENCRYPTED: Final = 0x1
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
    statements = {}
    if sequence.unit is not None:
        statements["unit"] = sequence.unit
    if sequence.topology is not None:
        statements["topology"] = sequence.topology.name
    if sequence.grid is not None:
        statements["grid"] = " ".join(map(str, sequence.grid))
    width = max(4, len(str(sequence.n_frames - 1)))
    names = [f"frame_{i:0{width}d}.ply" for i in range(sequence.n_frames)]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, positions in zip(names, sequence.vertices, strict=True):
            archive.writestr(
                zipfile.ZipInfo(name, _NO_DATE),
                write_ply(positions, sequence.faces, statements),
                compress_type=zipfile.ZIP_DEFLATED,
            )
        if sequence.times is not None:
            archive.writestr(
                zipfile.ZipInfo("frames.ply.series", _NO_DATE),
                write_series(names, sequence.times.tolist()),
            )
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
        if not info.filename:
            raise _refused(info, "without a name")
        if info.is_dir():
            continue
        if stat.S_ISLNK(info.external_attr >> 16):
            raise _refused(info, "a link")
        if info.flag_bits & _ENCRYPTED:
            raise _refused(info, "encrypted")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise _refused(info, "compressed in another way than 'deflate'")
        if info.filename in members:
            raise _refused(info, "there twice")
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


def _refused(info: zipfile.ZipInfo, what: str) -> MalformedFileError:
    return MalformedFileError(
        f"The member {info.filename[-60:]!r} of the archive is {what}.",
        remedy=_REMEDY,
        details={"name": info.filename[-200:]},
    )
