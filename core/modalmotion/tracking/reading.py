"""Observations from files: a mesh, a cloud or contours for each frame, or one npz for all."""

import codecs
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from modalmotion.errors import MalformedFileError, ParameterError, ShapeError
from modalmotion.formats import detect, frame_files, npz, volumes
from modalmotion.formats.frame import NOTHING_TO_TRACK, in_frame
from modalmotion.formats.frames import read_mesh
from modalmotion.formats.parser_process import ParserProcess
from modalmotion.formats.result import Parser
from modalmotion.formats.text_meshes import lines_of
from modalmotion.formats.volumes import reading
from modalmotion.images import ImageSequence
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh import UNKNOWN
from modalmotion.notes import Note
from modalmotion.progress import Reporter, reported
from modalmotion.representation import Array, Floats, shown
from modalmotion.tracking.label_values import whole_labels
from modalmotion.tracking.landmarks import (
    LANDMARK_SUFFIXES,
    landmarks_from_json,
    read_landmark_file,
)
from modalmotion.tracking.observation import (
    NAMED_PLACES,
    Observation,
    of_surface,
)

CLOUD_SUFFIXES: Final = (".csv", ".xyz", ".txt")
"""Ends of the names of files of points, three numbers a line."""

# biv-me's files: tab-separated x, y, z, type, slice, weight, frame.
_GUIDE_POINTS: Final = "GPFile"
_GUIDE_POINT: Final = "f8, f8, f8, U64, U32, U32, U32"
_VALVES: Final = ("MITRAL_VALVE", "AORTA_VALVE")
_APEX: Final = "APEX_POINT"

# The surface whose rim the valves are at; of others they are near the middle of the opening.
_WITH_VALVES: Final = "LV_ENDOCARDIAL"

# What separates the numbers of a line, and how a line of numbers starts.
_SPACED: Final = bytes.maketrans(b",;", b"  ")
_NUMBER: Final = re.compile(rb"\s*[-+]?(\.?[0-9]|(nan|inf)\b)", re.IGNORECASE)

_NOWHERE: Final = np.full(3, np.nan)
_SYSTEM: Final = "coordinate_system"

_REMEDY: Final = (
    "Use a zip or folder with one file per frame, a table (.csv) with the columns frame, x, y, z, "
    "an npz of points and offsets, or VTKHDF."
)


_NPZ_REMEDY: Final = (
    "Store points (n, 3) and offsets (frames + 1,), the first row of each frame and the end, or "
    "points (frames, n, 3); times, apex and base as numbers; unit, coordinates and landmarks "
    "(JSON) as text."
)


@shown("frames", "unit", "landmarks")
@dataclass(frozen=True, eq=False)
class Recorded:
    """Observations of all frames, as files state them.

    Parameters
    ----------
    frames : sequence
        As `observed_frames` takes it.
    landmarks : mapping of "apex" and "base" to (frames, 3) float64
        NaN if a frame states none.
    times : (frames,) float64, s, or None
    unit : str or None
    notes : tuple of Note
    coordinates : {"LPS", "RAS"} or None
        As the files of the points state it; landmarks are in the same.
    images : ImageSequence or None
        In place of frames of points.
    are_typed : bool
        Whether points are contours with names, of which some were read.
    """

    frames: Sequence[Any]
    landmarks: Mapping[str, Floats]
    times: Floats | None = None
    unit: str | None = None
    notes: tuple[Note, ...] = ()
    coordinates: str | None = None
    images: ImageSequence | None = None
    are_typed: bool = False

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.frames) if self.images is None else self.images.n_frames


def read_observed(
    source: bytes | Path,
    *,
    labels: Sequence[str | int] = (),
    coordinates: str = UNKNOWN,
    progress: Reporter | None = None,
    limits: ReadLimits | None = None,
    parser: Parser | None = None,
) -> Recorded:
    """Read the observations in a folder or zip of one file per frame, or in one npz.

    Parameters
    ----------
    source : bytes or Path
        Bytes are read without opening a file. Frames come in the natural order of the numbers in
        their names. An npz has `points` (n, 3) and `offsets` (frames + 1,), the first row of each
        frame and the end; or `points` (frames, n, 3), in which rows of NaN are left out; and
        maybe `times` and `unit`. VTKHDF has points in each step.
    labels : sequence of str, optional
        Of files of typed contours (biv-me's GPFile): parts of the names of the types to read, by
        default LV_ENDOCARDIAL.
    coordinates : {"LPS", "RAS"}, optional
        Of the points, where no file states it: files of landmarks are turned to it.
    progress : callable, optional
        Called with the frames read and all of them.
    limits : ReadLimits, optional
    parser : Parser, optional
        Parser to reuse for many files; its own limits then apply.

    Raises
    ------
    InputError
        Naming the frame and the file that cannot be read.
    """
    if parser is None:
        with ParserProcess(DEFAULT_LIMITS if limits is None else limits) as own:
            return read_observed(
                source, labels=labels, coordinates=coordinates, progress=progress, parser=own
            )
    if reading.holds_images(source):
        # Before much is read.
        whole_labels(labels)
        return recorded_images(volumes.read_images(source, parser=parser, progress=progress))
    if isinstance(source, Path) and source.is_dir():
        files = {path.name: path.read_bytes for path in source.iterdir() if path.is_file()}
        return _of_files(files, labels, coordinates, parser, progress)
    try:
        data = source if isinstance(source, bytes) else source.read_bytes()
    except OSError as error:
        raise MalformedFileError(
            f"'{Path(str(source)).name}' cannot be read: {error.strerror}.", remedy=_REMEDY
        ) from error
    kind = detect.detect_format(data) if data else None
    if kind is detect.Format.ZIP:
        with frame_files.opened(data, parser) as archive:
            return _of_files(archive.files, labels, coordinates, archive, progress)
    if kind is detect.Format.NPZ:
        return _of_npz(data, parser.limits)
    if kind is detect.Format.HDF5:
        return _of_vtkhdf(data, parser)
    if kind in detect.MESH_FORMATS:
        observed, _, states = _of_mesh(data, parser)
        unit, system = states.get("unit"), states.get(_SYSTEM)
        return Recorded((observed,), {}, unit=unit, coordinates=system)
    if kind is None and (table := _table(data)) is not None:
        clouds, times = table
        most = max(map(len, clouds), default=0)
        parser.limits.require(frames=len(clouds), vertices=most)
        return Recorded(_clouds(clouds), {}, times)
    if kind is None:
        message = detect.unknown_format(data).message if data else "The file is empty."
        raise MalformedFileError(message, remedy=_REMEDY)
    raise MalformedFileError(
        f"The file is {kind.upper()}, which contains a whole sequence of one mesh.",
        remedy=f"{NOTHING_TO_TRACK} {_REMEDY}",
    )


def holds_contours(source: Path) -> bool:
    """Whether a path is a folder of typed contours, which are tracked and are no meshes."""
    return source.is_dir() and any(one.name.startswith(_GUIDE_POINTS) for one in source.iterdir())


def recorded_images(images: ImageSequence) -> Recorded:
    """Take images as what was recorded."""
    return Recorded((), {}, images.times, "mm", images.notes, "LPS", images)


def _of_files(
    files: Mapping[str, Callable[[], bytes]],
    labels: Sequence[str | int],
    coordinates: str,
    parser: Parser,
    progress: Reporter | None,
) -> Recorded:
    visible = [name for name in files if not frame_files.is_hidden(name)]
    names, times, notes = _listed(visible, files, parser.limits)
    parser.limits.require(frames=len(names))
    frames: list[_FrameFile] = []
    for k, name in enumerate(reported(names, progress)):
        with in_frame(k, name):
            frames.append(_frame(name, files[name](), labels, parser))
            system, first = frames[k].states.get(_SYSTEM), frames[0].states.get(_SYSTEM)
            if system != first:
                raise ShapeError(
                    f"Its coordinate system is {system}, that of frame 0 {first}.",
                    remedy="Save all frames in one coordinate system.",
                )
    landmarks = {
        name: np.stack([frame.landmarks.get(name, _NOWHERE) for frame in frames])
        for name in sorted({name for frame in frames for name in frame.landmarks})
    }
    system, unit = frames[0].states.get(_SYSTEM), frames[0].states.get("unit")
    if times is None and all("time" in frame.states for frame in frames):
        times = tuple(float(frame.states["time"]) for frame in frames)
    marked = [name for name in visible if name.lower().endswith(LANDMARK_SUFFIXES)]
    for name in sorted(marked, key=frame_files.natural_key):
        with in_frame(None, name):
            file = read_landmark_file(files[name]())
            places = file.for_points(system or coordinates, unit)
        frame_of = _frame_of(name, names)
        for mark, place in places.items():
            if frame_of is None:
                landmarks[mark] = place
                continue
            # Beside what is known of others.
            rows = np.array(np.broadcast_to(landmarks.get(mark, _NOWHERE), (len(names), 3)))
            rows[frame_of] = place
            landmarks[mark] = rows
        notes += file.notes
    at = None if times is None else np.array(times, dtype=np.float64)
    observed = tuple(frame.observed for frame in frames)
    are_typed = Path(names[0]).name.startswith(_GUIDE_POINTS)
    return Recorded(observed, landmarks, at, unit, notes, system, are_typed=are_typed)


def _listed(
    visible: list[str], files: Mapping[str, Callable[[], bytes]], limits: ReadLimits
) -> tuple[tuple[str, ...], tuple[float, ...] | None, tuple[Note, ...]]:
    """Choose the frames among files, in the order of time; with times and notes."""
    if any(name.lower().endswith(frame_files.SERIES_SUFFIXES) for name in visible):
        listing = frame_files.list_frames(visible, lambda name: files[name](), limits)
        return listing.names, listing.times, listing.notes
    kinds = (*frame_files.FRAME_SUFFIXES, *CLOUD_SUFFIXES)
    names = sorted(
        (name for name in visible if name.lower().endswith(kinds)), key=frame_files.natural_key
    )
    names = [n for n in names if Path(n).name.startswith(_GUIDE_POINTS)] or names
    if not names:
        raise MalformedFileError(
            f"None of {len(files)} files is a frame.",
            remedy=f"Give one file per frame, ending with {', '.join(kinds)}.",
        )
    return tuple(names), None, frame_files.notes_on_numbers(tuple(names))


def _frame_of(name: str, frames: Sequence[str]) -> int | None:
    """Frame that a file of landmarks belongs to by its name: scan_3.mrk.json to scan_3.ply."""
    stem = name.lower().removesuffix("landmarks.json").removesuffix(".mrk.json").rstrip("._-")
    stems = [frame.lower().rpartition(".")[0] for frame in frames]
    return stems.index(stem) if stems.count(stem) == 1 else None


class _FrameFile(NamedTuple):
    """One frame as its file states it."""

    observed: tuple[Observation, ...]
    landmarks: Mapping[str, Floats] = {}
    states: Mapping[str, str] = {}


def _frame(name: str, data: bytes, labels: Sequence[str | int], parser: Parser) -> _FrameFile:
    if Path(name).name.startswith(_GUIDE_POINTS):
        return _guide_points(data, tuple(map(str, labels)) or (_WITH_VALVES,))
    if not name.lower().endswith(CLOUD_SUFFIXES):
        return _of_mesh(data, parser)
    points = _cloud(data)
    parser.limits.require(vertices=len(points))
    return _FrameFile((Observation(points),))


def _of_mesh(data: bytes, parser: Parser) -> _FrameFile:
    mesh, _ = read_mesh(data, None, parser.limits)
    is_cloud = not len(mesh.faces)
    own = (
        Observation(mesh.positions.astype(np.float64))
        if is_cloud
        else of_surface(mesh.positions, mesh.faces)
    )
    return _FrameFile((own,), states=dict(mesh.statements))


def _cloud(data: bytes) -> Floats:
    """Read points from lines of three numbers or more, after a heading if there is one."""
    lines = [line.translate(_SPACED) for line in lines_of(data.removeprefix(codecs.BOM_UTF8))]
    first = next((k for k, line in enumerate(lines) if _NUMBER.match(line)), len(lines))
    return _numbers(lines[first:], None, 3)


def _numbers(lines: Sequence[bytes], delimiter: str | None, n_columns: int) -> Floats:
    rows: Floats = np.zeros((0, n_columns))
    lines = [line for line in lines if line.strip()]
    try:
        if lines:
            rows = np.loadtxt(lines, delimiter=delimiter, usecols=range(n_columns), ndmin=2)
    except ValueError as error:
        raise MalformedFileError(
            f"A cell is not a number, or missing ({str(error)[:60]}).",
            remedy="Write x, y and z of one point per line; in a table of all frames, also frame "
            "or time (s).",
        ) from error
    return rows


def _table(data: bytes) -> tuple[list[Floats], Floats | None] | None:
    """Read a table of points of all frames: columns x, y, z and frame or time (s); None of others.

    Without a column of frames or times all points are of one frame.
    """
    first = next(iter(lines_of(data)), b"").decode("utf-8-sig", errors="replace")
    delimiter = max(",;\t", key=first.count)
    names = [name.strip().strip('"').lower() for name in first.split(delimiter)]
    if not {"x", "y", "z"} <= {*names}:
        return None
    rows = _numbers([*lines_of(data)][1:], delimiter, len(names))
    points = rows[:, [names.index(name) for name in "xyz"]]
    key = next((name for name in ("frame", "time", "t") if name in names), None)
    if key is None:
        return [points], None
    values, frames = np.unique(rows[:, names.index(key)], return_inverse=True)
    clouds = [points[frames == k] for k in range(len(values))]
    return clouds, None if key == "frame" else values


def _guide_points(data: bytes, contours: Sequence[str]) -> _FrameFile:
    """Read typed contour points; valves are at the base, and the apex point is the apex."""
    lines = [line for line in lines_of(data) if not line.startswith(b"x\t")]
    if not lines:
        return _FrameFile(())
    try:
        *axes, kinds, planes, _, times = np.loadtxt(
            lines, _GUIDE_POINT, None, "\t", usecols=range(7), unpack=True, ndmin=1
        )
    except ValueError as error:
        raise MalformedFileError(
            f"A line is not x, y, z, type, slice, weight and frame ({str(error)[:60]}).",
            remedy="Send the guide point files as biv-me writes them.",
        ) from None
    places = np.column_stack(axes)
    for name in np.unique(kinds):
        # Of some slices recorders write the weight there, 1.0, which is no number of a frame.
        if len({time for time in times[kinds == name] if time.isdigit()}) > 1:
            raise MalformedFileError(
                f"{name[:40]} has points of two time frames in one file.",
                remedy="Write one file for each time frame.",
            )
    names = [name for name in np.unique(kinds) if any(kind in name for kind in contours)]
    if not names:
        raise ParameterError(
            f"There is no contour called {', '.join(map(repr, contours))}.",
            remedy=f"Use names from this list: {', '.join(np.unique(kinds))}.",
        )
    observed = [Observation(places[np.isin(kinds, names)])]
    at_valve, at_apex = np.isin(kinds, _VALVES), kinds == _APEX
    landmarks = {"apex": places[at_apex].mean(axis=0)} if at_apex.any() else {}
    if at_valve.any() and all(_WITH_VALVES in name for name in names):
        each = [places[at_valve & (planes == one)] for one in np.unique(planes[at_valve])]
        observed.append(Observation(np.concatenate([*map(_farthest, each)]), end="base"))
    elif at_valve.any():
        landmarks["base"] = places[at_valve].mean(axis=0)
    return _FrameFile(tuple(observed), landmarks)


def _farthest(points: Floats) -> Floats:
    """Take the two points of one slice that are farthest apart, of several.

    A plane meets the rim of the opening twice. Where it shows both valves, the points between are
    at their junction, within the opening.
    """
    if len(points) <= 2:
        return points
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    pair: Floats = points[list(divmod(int(apart.argmax()), len(points)))]
    return pair


def _of_npz(data: bytes, limits: ReadLimits) -> Recorded:
    names = ("points", "offsets", "times", "unit", "coordinates", "landmarks", *NAMED_PLACES)
    try:
        arrays, _ = npz.read_arrays(data, names, names[:1], limits.of_file(len(data)))
    except (MalformedFileError, ShapeError) as error:
        error.remedy = f"{_NPZ_REMEDY} {NOTHING_TO_TRACK}"
        if "'vertices'" in str(error.details.get("arrays")):
            error.remedy = NOTHING_TO_TRACK
        raise
    landmarks = landmarks_from_json(npz.text_in(arrays, "landmarks") or "{}")
    own = {name: arrays[name].astype(np.float64) for name in NAMED_PLACES if name in arrays}
    unit, coordinates = npz.text_in(arrays, "unit"), npz.text_in(arrays, "coordinates")
    times = arrays.get("times")
    frames = _clouds(_clouds_in(arrays, limits))
    return Recorded(frames, landmarks | own, times, unit, coordinates=coordinates)


def _clouds_in(arrays: Mapping[str, Array], limits: ReadLimits) -> list[Array]:
    """Take the points of each frame out of the arrays of an npz."""
    points, offsets = arrays["points"], arrays.get("offsets")
    if offsets is None:
        if points.ndim != 3 or points.shape[2] != 3 or points.dtype.kind not in "fiu":
            raise MalformedFileError(
                f"The points have the shape {points.shape}, and the frame offsets are missing.",
                remedy=_NPZ_REMEDY,
            )
        limits.require(frames=len(points), vertices=points.shape[1])
        # Frames of fewer points are filled up with NaN.
        return [x[~np.isnan(x).all(axis=1)] for x in points]
    n = len(points) if points.ndim == 2 else -1
    is_whole = offsets.ndim == 1 and offsets.dtype.kind in "iu" and offsets.size > 1
    if not is_whole or (offsets[0], offsets[-1]) != (0, n) or (offsets[1:] < offsets[:-1]).any():
        raise MalformedFileError(
            f"The offsets do not run from 0 to the {n} points.", remedy=_NPZ_REMEDY
        )
    limits.require(frames=offsets.size - 1, vertices=int(np.diff(offsets).max()))
    return [points[a:b] for a, b in pairwise(offsets)]


def _of_vtkhdf(data: bytes, parser: Parser) -> Recorded:
    answer = parser.parse("clouds", data)
    points, offsets = answer.arrays["points"], answer.arrays["offsets"]
    frames = _clouds([points[a:b] for a, b in pairwise(offsets)])
    return Recorded(frames, {}, answer.arrays.get("times"), answer.info["unit"])


def _clouds(clouds: Sequence[Array]) -> tuple[tuple[Observation], ...]:
    """Frames of points; what is wrong with one names it."""
    frames = []
    for k, points in enumerate(clouds):
        with in_frame(k):
            frames.append((Observation(points),))
    return tuple(frames)
