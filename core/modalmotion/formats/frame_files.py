"""Sequences of several files: in a folder, by a pattern of names, in a zip, or listed in a file.

Frames come in the natural order of the numbers in their names, or as one .pvd or .series file
among them lists them with their times.
"""

import io
import json
import math
import posixpath
import re
import stat
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Final, NamedTuple

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.formats import detect, npz, ply, vtk_xml
from modalmotion.formats.frame import TRACK, Frame, misread
from modalmotion.formats.frames import read_frames, read_mesh
from modalmotion.formats.named_arrays import XDMF_SUFFIXES, read_xdmf
from modalmotion.formats.result import Answer, Parser, Reading
from modalmotion.limits import NO_LIMITS, TEXT_UNFOLDING, ReadLimits
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.notes import Note
from modalmotion.progress import Reporter
from modalmotion.representation import counted

FRAME_SUFFIXES: Final = (".stl", ".ply", ".obj", ".off", ".vtk", ".vtp", ".vtu")
"""Ends of the names of files that contain one frame each."""

SERIES_SUFFIXES: Final = (".pvd", ".series")
"""Ends of the names of files that list frames and their times."""

LISTS: Final = (*SERIES_SUFFIXES, *XDMF_SUFFIXES)
"""Ends of the names of files that name others."""

_MESHES: Final = {".msh", ".inp", ".bdf", ".nas", ".mesh", ".med", ".e", ".exo", ".su2", ".unv"}
_IMAGE_ENDS: Final = {".nii", ".gz", ".nrrd", ".mha", ".dcm"}
_POINTS: Final = {".csv", ".txt", ".xyz", ".pcd"}

# Separators and drives of other systems, and control characters.
_UNSAFE: Final = re.compile(r"[\\:\x00-\x1f]")
_NUMBERED: Final = re.compile(r"(.*?)(\d{1,18})(\D*)", re.DOTALL)


def natural_key(name: str) -> tuple[tuple[str, int, str], ...]:
    """Sort key by which frame_2 comes before frame_10, and equal numbers by their writing."""
    # (text, digits, number) each; a number counts by its length first, however long it is.
    parts = [(text, number.lstrip("0")) for text, number in re.findall(r"(\D*)(\d*)", name)]
    return (*((text.casefold(), len(number), number) for text, number in parts), (name, 0, ""))


def is_hidden(name: str) -> bool:
    """Return whether a name is one that systems leave behind, such as .DS_Store."""
    return any(part.startswith((".", "__MACOSX")) for part in name.split("/"))


def _require_safe(name: str) -> None:
    if name.startswith("/") or ".." in name.split("/") or _UNSAFE.search(name):
        raise MalformedFileError(
            f"The name {name[:80]!r} leads out of the archive.",
            remedy="Pack the frames with plain relative names.",
        )


def _beside(source: str, name: str, there: set[str], frame: int | None = None) -> str:
    """Resolve a name in a file against that file's folder."""
    _require_safe(name)
    path = posixpath.normpath(posixpath.join(posixpath.dirname(source), name))
    if path not in there:
        raise MalformedFileError(
            f"{source[-60:]!r} names {name[-60:]!r}, which is not there.",
            remedy="Keep them together, in one folder or archive.",
            frame=frame,
        )
    return path


class Listing(NamedTuple):
    """Names of frames in the order of time, their times in s, other files, and notes."""

    names: tuple[str, ...]
    times: tuple[float, ...] | None
    others: tuple[str, ...] = ()
    notes: tuple[Note, ...] = ()


_malformed: Final = partial(
    MalformedFileError,
    remedy="Save the series again, or leave the file out: frames are then ordered by name.",
)


def read_series(data: bytes, limits: ReadLimits = NO_LIMITS) -> Listing:
    """Read a .pvd collection (XML) or a .series file (JSON).

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Raises
    ------
    MalformedFileError
        If it is neither, or contains a document type, entities, several parts for one time, or
        no frames.
    LimitError
        If it lists more frames than `limits` accept.
    """
    with misread(_malformed, "The series file is not of the form that ParaView writes"):
        if data.lstrip()[:1] == b"<":
            listed = _pvd(data, limits)
        else:
            listed = [(one["time"], one["name"]) for one in json.loads(data)["files"]]
        entries = [(float(time), name) for time, name in listed]
    if not entries:
        raise _malformed("The series file lists no frames.")
    for time, name in entries:
        if not isinstance(name, str) or not name or not math.isfinite(time):
            what = f"the time {time} and the file {str(name)[:40]!r}"
            raise _malformed(f"An entry of the series file has {what}.")
    limits.require(frames=len(entries))
    ordered = sorted(entries, key=lambda entry: entry[0])
    notes = (Note.of("frames_sorted"),) if ordered != entries else ()
    times, names = zip(*ordered, strict=True)
    return Listing(names, times, notes=notes)


def _pvd(data: bytes, limits: ReadLimits) -> list[tuple[str, str | None]]:
    root = vtk_xml.xml_tree(data, ".pvd", _malformed, 2 * limits.frames + 100)
    if root.tag == "VTKFile" and (kind := root.get("type")) != "Collection":
        raise _malformed(f"The .pvd file is of the type {str(kind)[:40]!r}, not 'Collection'.")
    listed = [*root.iter("DataSet")]
    if any(one.get("part", "0") not in ("0", "") for one in listed):
        raise MalformedFileError(
            "The .pvd file lists several parts for one time.",
            remedy="Merge the parts of each time into one surface, and save again.",
        )
    return [(one.get("timestep", "none"), one.get("file")) for one in listed]


def write_series(names: list[str], times: list[float]) -> bytes:
    """Write a .series file, which ParaView opens as one file over time."""
    files = [{"name": name, "time": time} for name, time in zip(names, times, strict=True)]
    return json.dumps({"file-series-version": "1.0", "files": files}, indent=1).encode()


def list_frames(names: list[str], read: Callable[[str], bytes], limits: ReadLimits) -> Listing:
    """Choose and sort the frames among files.

    Parameters
    ----------
    names : list of str
    read : callable
        Returns the bytes of one of them.
    limits : ReadLimits

    Raises
    ------
    MalformedFileError
        If there are several kinds of frames without a list, or several lists, or one that names
        what is not there.
    """
    visible = [name for name in names if not is_hidden(name)]
    lists = [name for name in visible if name.lower().endswith(SERIES_SUFFIXES)]
    if len(lists) > 1:
        raise MalformedFileError(
            f"There are several lists of frames: {', '.join(map(repr, sorted(lists)[:4]))}.",
            remedy="Keep one .pvd or .series file, or none.",
        )
    if lists:
        (source,), there = lists, set(visible)
        series = read_series(read(source), limits)
        listed = tuple(_beside(source, name, there, k) for k, name in enumerate(series.names))
        unit = Note.of("time_unit_unknown", file=source[-60:])
        others = tuple(sorted(there - {source, *listed}))
        return Listing(listed, series.times, others, (*series.notes, unit))
    frames = [name for name in visible if name.lower().endswith(FRAME_SUFFIXES)]
    kinds = sorted({name.lower().rpartition(".")[2] for name in frames})
    if len(kinds) > 1:
        raise MalformedFileError(
            f"There are frames of several kinds: {', '.join(kinds)}.",
            remedy="Send one kind, or add a .pvd or .series file that names the frames.",
        )
    ordered = tuple(sorted(frames, key=natural_key))
    others = tuple(sorted(set(visible) - set(frames)))
    return Listing(ordered, None, others, notes_on_numbers(ordered))


def notes_on_numbers(names: tuple[str, ...]) -> tuple[Note, ...]:
    """Note gaps in the numbers in the names of frames: nothing else would show them.

    Parameters
    ----------
    names : tuple of str
        In their order. Only the last number of each counts, where all else is the same.
    """
    parts = [_NUMBERED.fullmatch(name.rpartition(".")[0]) for name in names]
    if len(names) < 3 or not all(parts) or len({(p[1], p[3]) for p in parts if p}) > 1:
        return ()
    numbers = [int(p[2]) for p in parts if p]
    steps = [b - a for a, b in pairwise(numbers)]
    missing = sum(step // min(steps) - 1 for step in steps) if min(steps) > 0 else 0
    if not missing:
        return ()
    first = next(k for k, step in enumerate(steps) if step > min(steps))
    note = Note.of(
        "frames_missing",
        frames=counted(missing, "frame"),
        before=names[first][-60:],
        after=names[first + 1][-60:],
    )
    return (note,)


def read_files(
    names: list[str],
    read: Callable[[str], bytes],
    parser: Parser,
    progress: Reporter | None = None,
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
        (grid,), there = grids, set(visible)
        return read_xdmf(read(grid), lambda name: read(_beside(grid, name, there)), parser)
    listing = list_frames(names, read, parser.limits)
    if not listing.names:
        raise _no_frames(visible)

    def frame(name: str) -> tuple[Frame, detect.Format]:
        return read_mesh(read(name), None, parser.limits)

    found = read_frames(listing.names, frame, parser.limits, listing.times, progress)
    notes, ignored = (*found.notes, *listing.notes), (*found.ignored, *listing.others)
    return replace(found, notes=notes, ignored=ignored)


def _no_frames(names: list[str]) -> MalformedFileError:
    ends = Counter(PurePosixPath(name).suffix.lower() or "no ending" for name in names)
    seen = ", ".join(f"{n} {end}" for end, n in ends.most_common(4))
    remedy = f"Send files that end in {', '.join(FRAME_SUFFIXES)}."
    if ends.keys() & _MESHES:
        remedy = detect.CONVERT
    elif ends.keys() & _IMAGE_ENDS:
        remedy = detect.OF_IMAGES
    elif ends.keys() & _POINTS:
        remedy = f"Clouds and contours are for {TRACK}."
    return MalformedFileError(
        f"There are no frames among {counted(len(names), 'file')}{f' ({seen})' if seen else ''}.",
        remedy=remedy,
    )


def read_folder(path: Path, parser: Parser, progress: Reporter | None = None) -> Reading:
    """Read a sequence from the files in a folder, or from those that match a pattern.

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
    found = [file for file in folder.glob("*" if is_list else pattern) if file.is_file()]
    if is_list:
        found = [file for file in found if file == path or not file.name.lower().endswith(LISTS)]
    if is_list or (is_whole and any(file.name.endswith(LISTS) for file in found)):
        # A list of frames may name those in folders beneath it.
        found += [file for file in folder.glob("*/*") if file.is_file()]
    paths = {file.relative_to(folder).as_posix(): file for file in found}

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


@dataclass(frozen=True)
class Archive:
    """An archive whose declared sizes and names have been checked, and the parser of its files.

    Parameters
    ----------
    files : dict of str to callable
        Each returns the bytes of a member: those that it declares and no more.
    sizes : dict of str to int
        Bytes of each.
    parser : Parser
    limits : ReadLimits
        On an archive of that size.
    """

    files: Mapping[str, Callable[[], bytes]]
    sizes: dict[str, int]
    parser: Parser
    limits: ReadLimits

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file inside of it."""
        return self.parser.parse(task, data)


def read_zip(data: bytes, parser: Parser, progress: Reporter | None = None) -> Reading:
    """Read a sequence from a zip of frames. Nothing is unpacked to a disk.

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
        n_bytes = 0

        def read(name: str) -> bytes:
            nonlocal n_bytes
            # A list may name one frame many times.
            n_bytes += archive.sizes[name]
            archive.limits.require(decompressed_bytes=n_bytes)
            return archive.files[name]()

        return read_files([*archive.files], read, archive, progress)


@contextmanager
def opened(data: bytes, parser: Parser) -> Iterator[Archive]:
    """Open a zip and check what it declares before anything is read; see `read_zip`."""
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except npz.UNREADABLE as error:
        raise MalformedFileError(
            f"These {len(data)} bytes are not a readable .zip (the file may be cut short).",
            remedy=_REMEDY,
        ) from error
    limits = parser.limits.of_file(len(data), TEXT_UNFOLDING, _SMALLEST_TEXT)
    with archive:
        members = _plain_members(archive, limits)
        files = {name: partial(_content, archive, info) for name, info in members.items()}
        sizes = {name: info.file_size for name, info in members.items()}
        yield Archive(files, sizes, parser, limits)


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
        _require_safe(info.orig_filename)
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
                )
        members[info.filename] = info
    limits.require(decompressed_bytes=sum(info.file_size for info in members.values()))
    return members


def _content(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    try:
        return npz.member_content(archive, info).tobytes()
    except (*npz.UNREADABLE, MalformedFileError) as error:
        raise MalformedFileError(
            f"The member {info.filename[-60:]!r} of the archive is damaged ({str(error)[:80]}).",
            remedy="Send the file again, or pack it anew.",
        ) from error


def write_ply_zip(sequence: MeshSequence) -> bytes:
    """Write a sequence as a zip of binary PLY files, with a .series file for ParaView.

    Returns
    -------
    bytes
        `read_zip` reads it back with the same positions, faces, times and unit.
    """
    grid, topology = sequence.grid, sequence.topology
    stated = {
        "unit": sequence.unit or "",
        "topology": "" if topology is None else topology.name,
        "grid": " ".join(map(str, grid or ())),
    }
    statements = {name: value for name, value in stated.items() if value}
    width = max(4, len(str(sequence.n_frames - 1)))
    names = [f"frame_{i:0{width}d}.ply" for i in range(sequence.n_frames)]
    files = {
        name: ply.write_ply(positions, sequence.faces, statements)
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
