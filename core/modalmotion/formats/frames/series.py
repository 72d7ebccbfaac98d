"""Lists of frames with their times: ParaView's .pvd and .series files."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import partial
from typing import Any, Final
from xml.parsers import expat

from modalmotion.errors import InputError, MalformedFileError
from modalmotion.limits import NO_LIMITS, ReadLimits

_malformed: Final = partial(
    MalformedFileError,
    remedy="Save the series again, or leave the file out: frames are then ordered by name.",
)


@dataclass(frozen=True)
class Series:
    """Frames in the order of their times.

    Parameters
    ----------
    names : tuple of str
        As the file writes them.
    times : tuple of float
    notes : tuple of str
    """

    names: tuple[str, ...]
    times: tuple[float, ...]
    notes: tuple[str, ...]


def read_series(data: bytes, limits: ReadLimits = NO_LIMITS) -> Series:
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
    return Series(names, times, notes)


def write_series(names: list[str], times: list[float]) -> bytes:
    """Write a .series file, which ParaView opens as one file over time."""
    files = [{"name": name, "time": time} for name, time in zip(names, times, strict=True)]
    return json.dumps({"file-series-version": "1.0", "files": files}, indent=1).encode()


def _read_pvd(data: bytes, limits: ReadLimits) -> list[tuple[float, str]]:
    entries: list[tuple[float, str]] = []

    def refuse(*_: object) -> None:
        raise _malformed(
            "The .pvd file contains a document type or entities, which are never read."
        )

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag == "VTKFile" and attributes.get("type") != "Collection":
            raise _malformed(
                f"The .pvd file is of the type {attributes.get('type', '')[:40]!r}, not "
                "'Collection'."
            )
        if tag == "DataSet":
            if attributes.get("part", "0") not in ("0", ""):
                raise MalformedFileError(
                    "The .pvd file lists several parts for one time.",
                    remedy="Merge the parts of each time into one surface, and save again.",
                )
            entries.append(_entry(attributes.get("timestep"), attributes.get("file")))
            limits.require("frames", len(entries))

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = start
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise _malformed(f"The .pvd file is not readable XML ({str(error)[:80]}).") from error
    return entries


def _read_json(data: bytes) -> list[tuple[float, str]]:
    try:
        listed: Any = json.loads(data)["files"]
        return [_entry(entry["time"], entry["name"]) for entry in listed]
    except MalformedFileError:
        raise
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise _malformed(
            f"The .series file is not of the form that ParaView writes ({str(error)[:80]})."
        ) from error


def _entry(time: object, name: object) -> tuple[float, str]:
    try:
        value = float(time) if isinstance(time, str | int | float) else math.nan
    except (ValueError, OverflowError):
        value = math.nan
    if not isinstance(name, str) or not name or not math.isfinite(value):
        raise _malformed(
            f"An entry of the series file has the time {str(time)[:40]!r} and the file "
            f"{str(name)[:40]!r}."
        )
    return value, name
