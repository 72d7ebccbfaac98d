"""Observations from files: a mesh, a cloud or contours for each frame, or one npz for all."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError, ParameterError
from modalmotion.formats.frames.names import (
    FRAME_SUFFIXES,
    is_hidden,
    natural_key,
    require_safe_name,
)
from modalmotion.formats.mesh_file import read_mesh
from modalmotion.formats.npz import read_arrays
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.formats.text import lines_of
from modalmotion.limits import ReadLimits
from modalmotion.progress import Progress
from modalmotion.representation import shown
from modalmotion.tracking.observation import NAMED_PLACES, Observation, of_surface

CLOUD_SUFFIXES: Final = (".csv", ".xyz", ".txt")
"""Ends of the names of files of points, three numbers a line."""

# biv-me's files: tab-separated x, y, z, type, slice, weight, frame.
_GUIDE_POINTS: Final = "GPFile"
_GUIDE_COLUMNS: Final = 7
_VALVES: Final = ("MITRAL_VALVE", "AORTA_VALVE")
_APEX: Final = "APEX_POINT"
_USUAL_CONTOURS: Final = "LV_ENDOCARDIAL"


@shown("frames", "unit", "landmarks")
@dataclass(frozen=True, eq=False)
class Recorded:
    """Observations of all frames, as files state them.

    Parameters
    ----------
    frames : tuple of tuple of Observation
    landmarks : mapping of "apex" and "base" to (frames, 3) float64
        NaN where a frame states none.
    times : (frames,) float64, s, or None
    unit : str or None
    notes : tuple of str
    """

    frames: tuple[tuple[Observation, ...], ...]
    landmarks: Mapping[str, NDArray[np.float64]]
    times: NDArray[np.float64] | None = None
    unit: str | None = None
    notes: tuple[str, ...] = ()


def read_observed(
    source: Path,
    *,
    contours: Sequence[str] = (_USUAL_CONTOURS,),
    progress: Progress | None = None,
    limits: ReadLimits | None = None,
) -> Recorded:
    """Read the observations in a folder or zip of one file a frame, or in one npz.

    Parameters
    ----------
    source : Path
        Frames come in the natural order of the numbers in their names. An npz has `points` (n, 3)
        and `offsets` (frames + 1,), the first row of each frame and the end, and maybe `times`
        and `unit`.
    contours : sequence of str
        Of files of typed contours (biv-me's GPFile): parts of the names of the types to read.
    progress : callable, optional
        Called with the frames read and all of them.
    limits : ReadLimits, optional

    Raises
    ------
    InputError
        Naming the frame and the file that cannot be read.
    """
    limits = ReadLimits() if limits is None else limits
    if source.is_dir():
        names = {path.name: path.read_bytes for path in source.iterdir() if path.is_file()}
        return _of_files(names, contours, limits, progress)
    try:
        data = source.read_bytes()
    except OSError as error:
        raise MalformedFileError(
            f"'{source.name}' cannot be read: {error.strerror}.",
            remedy="Name a folder or zip of one file a frame, or an npz of points and offsets.",
        ) from error
    if source.suffix.lower() == ".npz":
        return _of_npz(data, limits)
    if not zipfile.is_zipfile(io.BytesIO(data)):
        raise MalformedFileError(
            f"'{source.name}' is neither a zip of frames nor an npz of points.",
            remedy="Name a folder or zip of one file a frame, or an npz of points and offsets.",
        )
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [info for info in archive.infolist() if not info.is_dir()]
        for info in members:
            require_safe_name(info.orig_filename)
        limits.require("decompressed_bytes", sum(info.file_size for info in members))
        names = {info.filename: partial(archive.read, info) for info in members}
        return _of_files(names, contours, limits, progress)


def _of_files(
    files: Mapping[str, Callable[[], bytes]],
    contours: Sequence[str],
    limits: ReadLimits,
    progress: Progress | None,
) -> Recorded:
    kinds = (*FRAME_SUFFIXES, *CLOUD_SUFFIXES)
    names = sorted(
        (n for n in files if not is_hidden(n) and n.lower().endswith(kinds)), key=natural_key
    )
    guided = [n for n in names if Path(n).name.startswith(_GUIDE_POINTS)]
    names = guided or names
    if not names:
        raise MalformedFileError(
            f"None of {len(files)} files is a frame.",
            remedy=f"Give one file a frame, ending with {', '.join(kinds)}.",
        )
    limits.require("frames", len(names))
    frames, landmarks = [], []
    with ParserProcess(limits) as parser:
        for k, name in enumerate(names):
            try:
                points, marks = _frame(name, files[name](), contours, parser)
            except InputError as error:
                error.frame = k if error.frame is None else error.frame
                error.message = f"Frame {k} ({Path(name).name[-60:]!r}): {error.message}"
                raise
            frames.append((points,))
            landmarks.append(marks)
            if progress is not None:
                progress(k + 1, len(names))
    stated = {name for marks in landmarks for name in marks}
    nowhere = np.full(3, np.nan)
    return Recorded(
        tuple(frames),
        {name: np.stack([m.get(name, nowhere) for m in landmarks]) for name in sorted(stated)},
    )


def _frame(
    name: str, data: bytes, contours: Sequence[str], parser: Parser
) -> tuple[Observation, dict[str, NDArray[np.float64]]]:
    if Path(name).name.startswith(_GUIDE_POINTS):
        return _guide_points(data, contours)
    if name.lower().endswith(CLOUD_SUFFIXES):
        return Observation(_cloud(data)), {}
    mesh, _ = read_mesh(data, None, parser)
    if not len(mesh.faces):
        return Observation(mesh.positions.astype(np.float64)), {}
    return of_surface(mesh.positions, mesh.faces), {}


def _cloud(data: bytes) -> NDArray[np.float64]:
    """Read points from lines of three numbers or more, after a heading if there is one."""
    rows: list[list[float]] = []
    for number, line in enumerate(lines_of(data), 1):
        words = line.replace(b",", b" ").replace(b";", b" ").split()
        try:
            rows.append([float(word) for word in words[:3]])
        except ValueError:
            if rows:
                raise MalformedFileError(
                    f"Line {number} is not three numbers: {line[:40]!r}.",
                    remedy="Write x, y and z of one point a line.",
                ) from None
            continue
        if len(rows[-1]) != 3:
            raise MalformedFileError(
                f"Line {number} has {len(words)} numbers in place of three.",
                remedy="Write x, y and z of one point a line.",
            )
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _guide_points(
    data: bytes, contours: Sequence[str]
) -> tuple[Observation, dict[str, NDArray[np.float64]]]:
    """Read typed contour points; valves are the base, and the apex point the apex."""
    parts: dict[str, list[list[float]]] = {}
    for number, line in enumerate(lines_of(data), 1):
        words = line.split(b"\t")
        if number == 1 and words[0] == b"x":
            continue
        try:
            row = [float(word) for word in words[:3]]
        except ValueError:
            row = []
        if len(words) < _GUIDE_COLUMNS or len(row) != 3:
            raise MalformedFileError(
                f"Line {number} is not x, y, z, type, slice, weight and frame: {line[:40]!r}.",
                remedy="Send the guide point files as biv-me writes them.",
            )
        parts.setdefault(words[3].decode(errors="replace"), []).append(row)
    chosen = [name for name in parts if any(kind in name for kind in contours)]
    if parts and not chosen:
        raise ParameterError(
            f"No contour is called {', '.join(map(repr, contours))}.",
            remedy=f"Name parts of these: {', '.join(sorted(parts))}.",
        )
    landmarks = {}
    valves = _rows(parts, _VALVES)
    if len(valves):
        landmarks["base"] = valves.mean(axis=0)
    if _APEX in parts:
        landmarks["apex"] = np.array(parts[_APEX]).mean(axis=0)
    return Observation(_rows(parts, chosen)), landmarks


def _rows(parts: Mapping[str, list[list[float]]], names: Iterable[str]) -> NDArray[np.float64]:
    rows = [row for name in names for row in parts.get(name, [])]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _of_npz(data: bytes, limits: ReadLimits) -> Recorded:
    names = ("points", "offsets", "times", "unit", *NAMED_PLACES)
    try:
        arrays, _ = read_arrays(data, names, names[:2], limits.of_file(len(data)))
    except MalformedFileError as error:
        error.remedy = (
            "Write it with numpy.savez: points (n, 3) and offsets (frames + 1,), the first row of "
            "each frame, and the end. A sequence of one mesh needs no tracking."
        )
        raise
    points, offsets = arrays["points"], arrays["offsets"]
    n = len(points) if np.ndim(points) == 2 else -1
    is_whole = offsets.ndim == 1 and offsets.dtype.kind in "iu" and offsets.size > 1
    if (
        not is_whole
        or offsets[0] != 0
        or offsets[-1] != n
        or (np.diff(offsets.astype(np.int64)) < 0).any()
    ):
        raise MalformedFileError(
            f"The offsets do not run from 0 to the {n} points.",
            remedy="Give whole numbers that do not fall: the first row of each frame, and the end.",
        )
    limits.require("frames", offsets.size - 1)
    frames = tuple(_frame_of_npz(points[a:b], k) for k, (a, b) in enumerate(pairwise(offsets)))
    landmarks = {
        name: np.asarray(arrays[name], dtype=np.float64) for name in NAMED_PLACES if name in arrays
    }
    unit = str(arrays["unit"][()]) if "unit" in arrays else None
    return Recorded(frames, landmarks, arrays.get("times"), unit)


def _frame_of_npz(points: NDArray[Any], frame: int) -> tuple[Observation]:
    try:
        return (Observation(points),)
    except InputError as error:
        error.frame = frame
        error.message = f"Frame {frame}: {error.message}"
        raise
