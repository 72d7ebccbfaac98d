"""What tasks cost: processor time of an honest file of that size, known before it is read."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion.classification import CaseFile
from modalmotion.errors import InputError
from modalmotion.exports.signature_pack import SurfaceFormat
from modalmotion.formats.detect import Format, detect_format
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.parameters import (
    most_modes,
    reading_seconds,
    signature_seconds,
    spring_seconds,
)
from modalmotion.tracking.parameters import USUAL_MODES, TrackParameters
from modalmotion_service.http.negotiation import PNG
from modalmotion_service.schemas import queries, requests
from modalmotion_service.work.engine import Terms
from modalmotion_service.work.tasks import classification, files, sequences, signatures, tracks
from modalmotion_service.work.upload import Upload

# s for a picture, of which the first imports what draws it, and for one of many files.
_PICTURE: Final = 1.0
_PACKED: Final = 5e-3
# s for a byte of a kept sequence whose volumes are read, of a surface that is written out, and of
# images that are read, at most packed ones.
_READ_OUT: Final = 1e-6
_SURFACE: Final = 1e-7
_IMAGES: Final = 2e-7

_KNOWN: Final = {one.__name__ for one in (classification, sequences, signatures, tracks)}
"""Modules of tasks whose work is short where nothing else is stated."""

# s, and s for a byte of all files, beside reading them.
_RULES: Final[dict[Callable[..., Any], tuple[float, float]]] = {
    sequences.encode_sequence: (0.0, 5e-5),
    sequences.decode_upload: (0.0, 4e-4),
    signatures.tabulate: (0.0, _READ_OUT),
    signatures.read_out: (0.0, _READ_OUT),
    signatures.make_report: (_PICTURE, _READ_OUT),
    signatures.make_whole_report: (2 * _PICTURE, 4 * _READ_OUT + _SURFACE),
    # highdicom is imported.
    signatures.make_dicom: (3.0, _READ_OUT),
    signatures.make_view: (_PICTURE, _READ_OUT + _SURFACE),
    signatures.make_frames: (_PICTURE, _READ_OUT + _SURFACE),
    tracks.ingest_images: (1.0, _IMAGES),
    tracks.follow: (1.0, 0.0),
    tracks.show_track: (0.0, _IMAGES),
    classification.draw_card: (_PICTURE, 0.0),
    classification.measure: (_PICTURE, 0.0),
    # Two thousand exchanges of controls and recordings.
    classification.make_norm: (2.0, _READ_OUT),
    classification.ask_norm: (2.0, _READ_OUT),
    # scikit-learn is imported.
    classification.tabulate_features: (3.0, 0.0),
}


@dataclass(frozen=True)
class Tariff:
    """The terms of one owner's tasks.

    Parameters
    ----------
    owner : str
        As `Terms` has it.
    factor : float
        Most processor time of a task, in multiples of its price.
    least_seconds : float, s
        Processor time that every task may take.
    """

    owner: str
    factor: float
    least_seconds: float

    def terms(self, task: Callable[..., Any], args: Sequence[Any]) -> Terms:
        """Give the terms of a task with these arguments."""
        if task.__module__ not in _KNOWN:
            return Terms(self.owner)
        price = _price(task, args)
        # Of a surface that turns out to have no natural coordinates.
        dear = price + spring_seconds(_bytes(args), max(map(_modes_of, args), default=0))
        return Terms(self.owner, price, max(self.least_seconds, self.factor * dear))


def _price(task: Callable[..., Any], args: Sequence[Any]) -> float:
    (seconds, of_byte), size, first = _RULES.get(task, (0.0, 0.0)), _bytes(args), _bytes(args[:1])
    kind = _format(args[0]) if args and isinstance(args[0], Upload) else None
    price = seconds + of_byte * size
    if not any(isinstance(one, SignatureParameters) for one in args):
        price += reading_seconds(size, kind)
    price += _PICTURE if PNG in args or SurfaceFormat.PLY in args else 0.0
    for one in args:
        if isinstance(one, list) and len(one) > 1 and next(_files(one[0]), None) is not None:
            price += _PACKED * len(one)
        elif isinstance(one, SignatureParameters):
            price += signature_seconds(first, one, kind)
        elif isinstance(one, queries.ModesRequest):
            price += 1e-8 * one.modes * size
        elif isinstance(one, requests.EncodingTarget) and one.bytes is not None:
            price += 4e-3 * min(one.bytes, size)
        elif isinstance(one, TrackParameters) and isinstance(args[0], Path):
            price += 1.5e-6 * (1.0 + (one.modes / USUAL_MODES) ** 2) * first
        elif isinstance(one, TrackParameters):
            # Frames of some 500 points take 0.12 s in 37 modes, and the square of that in more.
            price += (5e-6 + 1e-5 * (one.modes / 37) ** 2) * first
    if task is signatures.measure_trade:
        # Modes of the largest set, each set fitted in several ways.
        price += 10 * signature_seconds(first, SignatureParameters(modes=args[2]))
    elif task is signatures.superpose:
        # Of about a hundred surfaces of a sequence.
        price += _SURFACE * size * max(1.0, len(args[2] or ()) / 100)
    elif task is classification.measure:
        # s for a case whose answer is measured, and compared in thousands of resamples.
        price += 1e-2 * len(args[2][0])
    return price


def _files(value: Any) -> Iterator[Path | Upload]:
    """Find all files among the arguments of a task."""
    if isinstance(value, (Path, Upload)):
        yield value
    elif isinstance(value, (list, tuple)):
        for one in value:
            yield from _files(one)
    elif isinstance(value, (files.Fitted, CaseFile)):
        yield from _files([*vars(value).values()])


def _bytes(value: Any) -> int:
    """Size of all files among the arguments; those that are still to be written have none."""
    size = 0
    for file in _files(value):
        with contextlib.suppress(OSError):
            size += file.n_bytes if isinstance(file, Upload) else file.stat().st_size
    return size


def _modes_of(argument: Any) -> int:
    """Most modes that are fitted for it; 0 where there is no fit."""
    if isinstance(argument, SignatureParameters):
        return most_modes(argument)
    return argument.modes if isinstance(argument, queries.ModesRequest) else 0


def _format(upload: Upload) -> Format | None:
    if upload.options.format is not None or upload.options.n_vertices is not None:
        return upload.options.format
    with contextlib.suppress(OSError, InputError):
        return detect_format(upload.data(1024))
    return None
