"""Which files are frames, and in which order: by their names, or by a .pvd or .series file."""

from __future__ import annotations

import json
import math
import posixpath
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Final

from modalmotion.errors import MalformedFileError
from modalmotion.formats.xml_trees import xml_tree
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.representation import counted

FRAME_SUFFIXES: Final = (".stl", ".ply", ".obj", ".off", ".vtk", ".vtp", ".vtu")
"""Ends of the names of files that contain one frame each."""

SERIES_SUFFIXES: Final = (".pvd", ".series")
"""Ends of the names of files that list frames and their times."""

# Separators and drives of other systems, and control characters.
_UNSAFE: Final = re.compile(r"[\\:\x00-\x1f]")


def natural_key(name: str) -> tuple[tuple[str, int, str], ...]:
    """Sort key by which frame_2 comes before frame_10, and equal numbers by their writing."""
    # (text, digits, number) each; a number counts by its length first, however long it is.
    parts = [(text, number.lstrip("0")) for text, number in re.findall(r"(\D*)(\d*)", name)]
    return (*((text.casefold(), len(number), number) for text, number in parts), (name, 0, ""))


def require_safe_name(name: str) -> None:
    """Refuse a name that leads out of the archive it is in.

    Raises
    ------
    MalformedFileError
        If it is absolute, goes up, names a drive, or contains control characters.
    """
    if name.startswith("/") or ".." in name.split("/") or _UNSAFE.search(name):
        raise MalformedFileError(
            f"The name {name[:80]!r} leads out of the archive.",
            remedy="Pack the frames with plain relative names.",
            details={"name": name[:80]},
        )


def is_hidden(name: str) -> bool:
    """Return whether a name is one that systems leave behind, such as .DS_Store."""
    return any(part.startswith((".", "__MACOSX")) for part in name.split("/"))


def name_beside(series: str, name: str) -> str:
    """Resolve a name in a series file against that file's folder."""
    require_safe_name(name)
    return posixpath.normpath(posixpath.join(posixpath.dirname(series), name))


_malformed: Final = partial(
    MalformedFileError,
    remedy="Save the series again, or leave the file out: frames are then ordered by name.",
)


@dataclass(frozen=True)
class Listing:
    """Frames in the order of time.

    Parameters
    ----------
    names : tuple of str
    times : tuple of float, s, or None
    others : tuple of str
        Files that are not frames.
    notes : tuple of str
    """

    names: tuple[str, ...]
    times: tuple[float, ...] | None
    others: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


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
    entries = _read_pvd(data, limits) if data.lstrip()[:1] == b"<" else _read_json(data)
    if not entries:
        raise _malformed("The series file lists no frames.")
    limits.require("frames", len(entries))
    ordered = sorted(entries, key=lambda entry: entry[0])
    notes = ("The frames were sorted by their times.",) if ordered != entries else ()
    times, names = zip(*ordered, strict=True)
    return Listing(names, times, notes=notes)


def write_series(names: list[str], times: list[float]) -> bytes:
    """Write a .series file, which ParaView opens as one file over time."""
    files = [{"name": name, "time": time} for name, time in zip(names, times, strict=True)]
    return json.dumps({"file-series-version": "1.0", "files": files}, indent=1).encode()


def _read_pvd(data: bytes, limits: ReadLimits) -> list[tuple[float, str]]:
    root = xml_tree(data, ".pvd", _malformed, 2 * limits.frames + 100)
    if root.tag == "VTKFile" and (kind := root.get("type")) != "Collection":
        raise _malformed(f"The .pvd file is of the type {str(kind)[:40]!r}, not 'Collection'.")
    listed = [*root.iter("DataSet")]
    if any(one.get("part", "0") not in ("0", "") for one in listed):
        raise MalformedFileError(
            "The .pvd file lists several parts for one time.",
            remedy="Merge the parts of each time into one surface, and save again.",
        )
    return [_entry(one.get("timestep"), one.get("file")) for one in listed]


def _read_json(data: bytes) -> list[tuple[float, str]]:
    try:
        listed: Any = json.loads(data)["files"]
        return [_entry(entry["time"], entry["name"]) for entry in listed]
    except MalformedFileError:
        raise
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        what = f"not of the form that ParaView writes ({str(error)[:80]})"
        raise _malformed(f"The .series file is {what}.") from error


def _entry(time: object, name: object) -> tuple[float, str]:
    try:
        value = float(time) if isinstance(time, str | int | float) else math.nan
    except (ValueError, OverflowError):
        value = math.nan
    if not isinstance(name, str) or not name or not math.isfinite(value):
        what = f"the time {str(time)[:40]!r} and the file {str(name)[:40]!r}"
        raise _malformed(f"An entry of the series file has {what}.")
    return value, name


_NUMBERED: Final = re.compile(r"(.*?)(\d{1,18})(\D*)", re.DOTALL)


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
        If there are no frames, several kinds of frames without a list, or several lists.
    """
    visible = [name for name in names if not is_hidden(name)]
    lists = [name for name in visible if name.lower().endswith(SERIES_SUFFIXES)]
    frames = [name for name in visible if name.lower().endswith(FRAME_SUFFIXES)]
    if len(lists) > 1:
        raise MalformedFileError(
            f"There are several lists of frames: {', '.join(map(repr, sorted(lists)[:4]))}.",
            remedy="Keep one .pvd or .series file, or none.",
        )
    if lists:
        return _as_listed(lists[0], visible, read, limits)
    kinds = sorted({name.lower()[-4:] for name in frames})
    if len(kinds) > 1:
        raise MalformedFileError(
            f"There are frames of several kinds: {', '.join(kinds)}.",
            remedy="Send one kind, or add a .pvd or .series file that names the frames.",
        )
    ordered = tuple(sorted(frames, key=natural_key))
    others = tuple(sorted(set(visible) - set(frames)))
    return Listing(ordered, None, others, notes_on_numbers(ordered))


def notes_on_numbers(names: tuple[str, ...]) -> tuple[str, ...]:
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
    return (
        (
            f"The numbers in the names leave out {counted(missing, 'frame')}, first between "
            f"{names[first][-60:]!r} and {names[first + 1][-60:]!r}: a file may be missing. Frames "
            "are counted as they come; without stated times they count as evenly spaced."
        ),
    )


def _as_listed(
    source: str, visible: list[str], read: Callable[[str], bytes], limits: ReadLimits
) -> Listing:
    series = read_series(read(source), limits)
    names = tuple(name_beside(source, name) for name in series.names)
    there = set(visible)
    for number, name in enumerate(names):
        if name not in there:
            raise MalformedFileError(
                f"{source[-60:]!r} lists {name[-60:]!r}, which is not there.",
                remedy="Pack the list together with the frames it names.",
                frame=number,
            )
    others = tuple(sorted(there - {source, *names}))
    notes = (*series.notes, f"{source[-60:]!r} has no unit of time; its values count as seconds.")
    return Listing(names, series.times, others, notes)
