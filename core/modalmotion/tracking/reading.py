"""Observations from files: a mesh, a cloud or contours for each frame, or one npz for all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError, ParameterError, ShapeError
from modalmotion.formats.detect import MESH_FORMATS, Format, detect_format, unknown_format
from modalmotion.formats.frames.archive import opened
from modalmotion.formats.frames.names import FRAME_SUFFIXES, is_hidden, natural_key
from modalmotion.formats.mesh_file import read_mesh
from modalmotion.formats.npz import read_arrays
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.formats.text import lines_of
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
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

USUAL_CONTOURS: Final = ("LV_ENDOCARDIAL",)
"""Parts of the names of typed contours that are read where nobody says which."""

_REMEDY: Final = "Use a zip or folder of one file a frame, or an npz of points and offsets."


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
    source: bytes | Path,
    *,
    contours: Sequence[str] = USUAL_CONTOURS,
    progress: Progress | None = None,
    limits: ReadLimits | None = None,
    parser: Parser | None = None,
) -> Recorded:
    """Read the observations in a folder or zip of one file a frame, or in one npz.

    Parameters
    ----------
    source : bytes or Path
        Bytes are read without opening a file. Frames come in the natural order of the numbers in
        their names. An npz has `points` (n, 3) and `offsets` (frames + 1,), the first row of each
        frame and the end, and maybe `times` and `unit`.
    contours : sequence of str
        Of files of typed contours (biv-me's GPFile): parts of the names of the types to read.
    progress : callable, optional
        Called with the frames read and all of them.
    limits : ReadLimits, optional
    parser : Parser, optional
        Parser to reuse for many files; its own limits then hold.

    Raises
    ------
    InputError
        Naming the frame and the file that cannot be read.
    """
    if parser is None:
        with ParserProcess(DEFAULT_LIMITS if limits is None else limits) as own:
            return _read(source, contours, own, progress)
    return _read(source, contours, parser, progress)


def _read(
    source: bytes | Path, contours: Sequence[str], parser: Parser, progress: Progress | None
) -> Recorded:
    if isinstance(source, bytes):
        return _of_bytes(source, contours, parser, progress)
    if source.is_dir():
        files = {path.name: path.read_bytes for path in source.iterdir() if path.is_file()}
        return _of_files(files, contours, parser, progress)
    try:
        data = source.read_bytes()
    except OSError as error:
        raise MalformedFileError(
            f"'{source.name}' cannot be read: {error.strerror}.", remedy=_REMEDY
        ) from error
    return _of_bytes(data, contours, parser, progress)


def _of_bytes(
    data: bytes, contours: Sequence[str], parser: Parser, progress: Progress | None
) -> Recorded:
    if not data:
        raise MalformedFileError("The file is empty.", remedy=_REMEDY)
    kind = detect_format(data)
    if kind is Format.NPZ:
        return _of_npz(data, parser.limits)
    if kind is Format.ZIP:
        with opened(data, parser) as archive:
            files = {name: member.read for name, member in archive.members.items()}
            return _of_files(files, contours, archive.parser, progress)
    if kind in MESH_FORMATS:
        return Recorded(((_of_mesh(data, parser),),), {})
    if kind is None:
        raise MalformedFileError(unknown_format(data).message, remedy=_REMEDY)
    raise MalformedFileError(
        f"The file is {kind.upper()}, which holds a sequence of one mesh.",
        remedy=f"Its vertices correspond: it needs no tracking. {_REMEDY}",
    )


def _of_files(
    files: Mapping[str, Callable[[], bytes]],
    contours: Sequence[str],
    parser: Parser,
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
    parser.limits.require("frames", len(names))
    frames, landmarks = [], []
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
        points = _cloud(data)
        parser.limits.require("vertices", len(points))
        return Observation(points), {}
    return _of_mesh(data, parser), {}


def _of_mesh(data: bytes, parser: Parser) -> Observation:
    mesh, _ = read_mesh(data, None, parser)
    if not len(mesh.faces):
        return Observation(mesh.positions.astype(np.float64))
    return of_surface(mesh.positions, mesh.faces)


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
    except ShapeError as error:
        error.remedy = (
            "Store points, offsets, times, apex and base (3,) or (frames, 3) as numbers, and the "
            "unit as text."
        )
        raise
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
    limits.require("vertices", int(np.diff(offsets).max()))
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
