"""What a file of images is read to: samples over time, and where they are.

Slices are put together by series, orientation and position to planes, by trigger time to phases.
"""

import logging
import re
import warnings
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError, ModalMotionError, ShapeError
from modalmotion.formats.result import Parsed
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.limits import ReadLimits
from modalmotion.notes import Note, notes_as_json
from modalmotion.numeric.unpacking import Packing, unpacked
from modalmotion.representation import Array, Bytes, Floats, Singles, counted


@contextmanager
def unheard(*names: str) -> Iterator[None]:
    """Keep libraries from warning and logging: they quote headers, with names of patients."""
    loggers = [logging.getLogger(name) for name in names]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, was in zip(loggers, before, strict=True):
            logger.disabled = was


@contextmanager
def damaged(message: str, remedy: str, *loggers: str) -> Iterator[None]:
    """Make one error of whatever libraries raise on a damaged file, and keep them quiet.

    Raises
    ------
    MalformedFileError
    """
    try:
        with unheard(*loggers):
            yield
    except ModalMotionError:
        raise
    except Exception:  # noqa: BLE001 - libraries raise whatever they meet
        raise MalformedFileError(message, remedy=remedy) from None


_UNIT_OF_TIME: Final = re.compile(r"(m|milli|u|micro)?s(ec(onds?)?)?")
_SHARES: Final = {"m": 1e-3, "milli": 1e-3, "u": 1e-6, "micro": 1e-6}

RAS_TO_LPS: Final = np.diag([-1.0, -1.0, 1.0])


def parsed(
    values: Array,
    time_axis: int | None,
    affine: Floats,
    limits: ReadLimits,
    *,
    times: Sequence[float] | float,
    unit: str | None,
    form: str,
    notes: list[Note],
) -> Parsed:
    """Put together the answer of a parser.

    Parameters
    ----------
    values : array of (i, j, k) and maybe time
    time_axis : int or None
        None of one frame.
    affine : (3, 4) float64, mm
        To LPS.
    limits : ReadLimits
    times : sequence of float, or float
        Of the frames, or from one to the next.
    unit : str or None
        Of times; without a known one they are not read, and noted.
    form : str
        Name of the format.
    notes : list of Note
    """
    frames = values[None] if time_axis is None else np.moveaxis(values, time_axis, 0)
    n = len(frames)
    limits.require(frames=n)
    if isinstance(times, float | int):
        is_regular = n > 1 and np.isfinite(times) and times > 0
        times = [k * times for k in range(n)] if is_regular else []
    match = _UNIT_OF_TIME.fullmatch(str(unit).strip().lower())
    scale = None if match is None else _SHARES.get(match[1], 1.0)
    if len(times) and scale is None:
        notes.append(Note.of("interval_ignored", format=form, interval=times[1] - times[0]))
    seconds = None if scale is None or not len(times) else [scale * float(time) for time in times]
    info = {"times": seconds, "notes": notes_as_json(notes)}
    return info, {"values": frames, "affine": np.asarray(affine, dtype=np.float64)[:3]}


def declared_bytes(
    shape: Sequence[int], itemsize: int, limits: ReadLimits, *, is_scaled: bool = False
) -> int:
    """Count the bytes that a header declares, before anything is read of them.

    Parameters
    ----------
    shape : sequence of int
    itemsize : int
    limits : ReadLimits
        On these bytes, and on the float32 that they become where they `is_scaled`.
    is_scaled : bool

    Raises
    ------
    MalformedFileError
        If a length is none.
    LimitError
        If they are too many.
    """
    n = 1
    for length in shape:
        if not 0 < int(length) < 2**31:
            raise MalformedFileError(
                f"The image has {length} samples along an axis.", remedy="Write the file again."
            )
        n *= int(length)
    limits.require(decompressed_bytes=n * (max(4, itemsize) if is_scaled else itemsize))
    return n * itemsize


def samples(
    data: bytes,
    kind: np.dtype[Any],
    shape: Sequence[int],
    limits: ReadLimits,
    *,
    start: int = 0,
    packing: Packing | None = None,
    head: int = 0,
    scale: tuple[float, float] = (1.0, 0.0),
) -> Array:
    """Read as many samples as a header declares, the first index fastest.

    Parameters
    ----------
    data : bytes
    kind : dtype
    shape : sequence of int
    limits : ReadLimits
    start : int
        First of their bytes, or of the packed ones.
    packing : {"gzip", "zlib"}, optional
    head : int
        Unpacked bytes before the samples.
    scale : tuple of float
        Slope and intercept. Stored numbers stay as they are if these change nothing.

    Raises
    ------
    MalformedFileError
        If there are fewer bytes, or they unpack to another size.
    LimitError
        If there are too many.
    """
    n_bytes = declared_bytes(shape, kind.itemsize, limits, is_scaled=scale != (1.0, 0.0))
    held: bytes | Bytes = data
    if packing is not None:
        limits.require(decompressed_bytes=head + n_bytes)
        held, start = unpacked(data, packing, head + n_bytes, start), head
    if len(held) - start < n_bytes:
        raise MalformedFileError(
            f"The header declares {n_bytes} bytes of samples, and {len(held) - start} are there.",
            remedy="Write the file again.",
        )
    values = np.frombuffer(held, kind, n_bytes // kind.itemsize, start).reshape(shape, order="F")
    return scaled(values, *scale)


def scaled(values: Array, slope: float, intercept: float) -> Array:
    """Apply slope and intercept; stored numbers stay as they are where these change nothing."""
    if slope == 1.0 and intercept == 0.0:
        return values
    plain: Singles = np.multiply(values, np.float32(slope), dtype=np.float32)
    plain += np.float32(intercept)
    return plain


# Slices of one plane agree to this, mm and as directions.
_SAME_PLACE: Final = 0.1
_SAME_DIRECTION: Final = 1e-3

# Slices nearer than this many pixels, regular to a tenth of the step, are a volume.
_DENSE: Final = 2.5
_FEWEST: Final = 4
_REGULAR: Final = 0.1


@dataclass(frozen=True, eq=False)
class Slice:
    """One slice: samples (i, j), affine (3, 4) and what was said of it."""

    values: Array
    affine: Floats
    info: dict[str, Any]

    @property
    def place(self) -> tuple[Any, ...]:
        """What files of one plane have in common."""
        axes = np.rint(self.affine[:, :2] / _SAME_DIRECTION).astype(np.int64)
        origin = np.rint(self.affine[:, 3] / _SAME_PLACE).astype(np.int64)
        return (self.info["series"], self.values.shape, *axes.ravel(), *origin)


def grouped(slices: Sequence[Slice]) -> ImageSequence:
    """Put slices together to images over time.

    Raises
    ------
    ShapeError
        If they belong to several patients, or no two planes have the same phases.
    """
    for name, told in (("patient", "patients"), ("space", "frames of reference")):
        n = len({own.info[name] for own in slices})
        if n > 1:
            raise ShapeError(
                f"The DICOM files are of {n} {told}.",
                remedy="Send the files of one examination of one patient.",
            )
    planes: dict[tuple[Any, ...], list[Slice]] = defaultdict(list)
    for own in slices:
        planes[own.place].append(own)
    notes: list[Note] = []
    ordered = [_in_time(group, notes) for group in planes.values()]
    n_phases, _ = max(Counter(map(len, ordered)).items(), key=lambda item: (item[1], item[0]))
    kept = [group for group in ordered if len(group) == n_phases]
    if len(kept) < len(ordered):
        notes.append(
            Note.of(
                "planes_left_out",
                n_phases=n_phases,
                planes=counted(len(ordered) - len(kept), "plane"),
            )
        )
    kept.sort(key=lambda group: tuple(group[0].affine.T.round(3).ravel()))
    starts = [group[0].info["trigger_ms"] for group in kept]
    late = [t for t in starts if t is not None and t > 100.0]
    if late and len(late) < len(starts):
        notes.append(
            Note.of(
                "planes_late", first=min(late), last=max(late), planes=counted(len(late), "plane")
            )
        )
    frames = [_frame([group[k] for group in kept]) for k in range(n_phases)]
    return ImageSequence(tuple(frames), *_times(kept, n_phases), tuple(notes))


def _in_time(group: list[Slice], notes: list[Note]) -> list[Slice]:
    if len(group) == 1:
        return group
    triggers = [own.info["trigger_ms"] for own in group]
    if all(t is not None for t in triggers) and len(set(triggers)) == len(group):
        return sorted(group, key=lambda own: float(own.info["trigger_ms"]))
    note = Note.of("trigger_times_unknown")
    if note not in notes:
        notes.append(note)
    return sorted(group, key=lambda own: own.info["number"] or 0.0)


def _times(kept: list[list[Slice]], n: int) -> tuple[Floats | None, float | None]:
    """Mean times over the planes, s, from 0, and the period."""
    rows = [[own.info["trigger_ms"] for own in group] for group in kept]
    full = [row for row in rows if all(t is not None for t in row) and len(set(row)) == n]
    if n < 2 or not full:
        return None, None
    times = np.mean([np.subtract(row, row[0]) for row in full], axis=0) / 1000.0
    span = float(times[-1])
    intervals = [own[0].info["interval_ms"] for own in kept]
    stated = [t / 1000.0 for t in intervals if t]
    period = float(np.median(stated)) if stated else 0.0
    return times, period if period > span else None


def _frame(slices: list[Slice]) -> Volume | PlaneSet:
    planes = (
        Plane(own.values, own.affine[:, [0, 1, 3]], float(own.info["thickness"])) for own in slices
    )
    return _volume(slices) or PlaneSet(tuple(planes))


def _volume(slices: list[Slice]) -> Volume | None:
    """Join parallel slices that lie densely and regularly; None of others."""
    first = slices[0]
    axes = first.affine[:, :2]
    if len(slices) < _FEWEST or any(
        own.values.shape != first.values.shape or np.abs(own.affine[:, :2] - axes).max() > 1e-3
        for own in slices
    ):
        return None
    normal = np.cross(axes[:, 0], axes[:, 1])
    normal /= np.linalg.norm(normal)
    slices = sorted(slices, key=lambda own: float(own.affine[:, 3] @ normal))
    origins = np.stack([own.affine[:, 3] for own in slices])
    steps = np.diff(origins, axis=0)
    step = steps.mean(axis=0)
    size = float(np.linalg.norm(step))
    if not 0 < size < _DENSE * float(np.linalg.norm(axes, axis=0).min()):
        return None
    if np.abs(steps - step).max() > _REGULAR * size:
        return None
    values = np.stack([own.values for own in slices], axis=-1)
    return Volume(values, np.column_stack([axes, step, origins[0]]))
