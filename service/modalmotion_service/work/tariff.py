"""What tasks cost: processor time of an honest file of that size, known before it is read."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

from modalmotion.errors import InputError
from modalmotion.exports.signature_pack import SurfaceFormat
from modalmotion.formats.detect import Format, detect_format
from modalmotion.norm.norm import FEWEST_RECORDINGS
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.parameters import (
    most_modes,
    reading_seconds,
    signature_seconds,
    spring_seconds,
)
from modalmotion.tracking.parameters import USUAL_MODES, TrackParameters
from modalmotion_service.http.negotiation import PNG
from modalmotion_service.schemas.queries import ModesRequest
from modalmotion_service.schemas.requests import EncodingTarget
from modalmotion_service.work.engine import Terms
from modalmotion_service.work.tasks import classification, derived, sequences, signatures, tracks
from modalmotion_service.work.tasks.files import Fitted
from modalmotion_service.work.upload import Upload

T = TypeVar("T")
Rule = Callable[[Sequence[Any]], float]

# s for a picture, of which the first imports what draws it.
_PICTURE: Final = 1.0
# s for a byte of a file that is encoded, at an error or to a size, and of a stream.
_ENCODED: Final = 5e-5
_ENCODED_TO_SIZE: Final = 4e-3
_DECODED: Final = 4e-4
# Modes of the largest set of a trade, each set fitted in several ways.
_WAYS_OF_TRADE: Final = 10
# s for a byte of a kept sequence whose volumes are read, and of a surface that is written out.
_READ_OUT: Final = 1e-6
_SURFACE: Final = 1e-7
_SURFACES_OF_SEQUENCE: Final = 100
# s for a signature among many, and for a mode at a byte of its template.
_PACKED: Final = 5e-3
# highdicom is imported.
_DICOM: Final = 3.0
# scikit-learn is imported.
_TABLE: Final = 3.0
_MODE: Final = 1e-8
# Two thousand exchanges of controls and recordings.
_COMPARED_COHORT: Final = 2.0
# s for a case whose answer is measured, and compared in thousands of resamples.
_CASE: Final = 1e-3
_COMPARED: Final = 1e-2

# s for a byte of points, and for one in 37 modes: frames of some 500 points take 0.12 s in them,
# and the square of that in more.
_OF_POINTS: Final = 5e-6
_OF_TRACKED_MODES: Final = 1e-5 / 37**2
_TRACK: Final = 1.0

# s for a byte of images that are read, at most packed ones, and of small ones that are tracked.
_IMAGES: Final = 2e-7
_TRACKED_IMAGES: Final = 1.5e-6

_HEAD_BYTES: Final = 1024


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
        rule = _RULES.get(task)
        price = math.inf if rule is None else rule(args)
        # Of a surface that turns out to have no natural coordinates.
        dear = price + spring_seconds(_bytes(args), _modes_of(args))
        return Terms(self.owner, price, max(self.least_seconds, self.factor * dear))


def _bytes(args: Iterable[Any]) -> int:
    """Size of all files among the arguments; those that are still to be written have none."""
    size = 0
    for one in args:
        if isinstance(one, Upload):
            size += one.n_bytes
        for file in one.files if isinstance(one, Fitted) else (one,):
            if isinstance(file, Path):
                with contextlib.suppress(OSError):
                    size += file.stat().st_size
    return size


def _modes_of(args: Iterable[Any]) -> int:
    """Most modes that are fitted; 0 where there is no fit."""
    modes = 0
    for one in args:
        if isinstance(one, SignatureParameters):
            modes = max(modes, most_modes(one))
        elif isinstance(one, ModesRequest):
            modes = max(modes, one.modes)
    return modes


def _format(upload: Upload) -> Format | None:
    if upload.options.format is not None or upload.options.n_vertices is not None:
        return upload.options.format
    with contextlib.suppress(OSError, InputError):
        return detect_format(upload.data(_HEAD_BYTES))
    return None


def _reading(args: Sequence[Any]) -> float:
    kind = _format(args[0]) if isinstance(args[0], Upload) else None
    return reading_seconds(_bytes(args), kind)


def _rule(seconds: float = 0.0, per_byte: float = 0.0) -> Rule:
    """Price the reading of all files, a picture if one is asked for, and this."""

    def price(args: Sequence[Any]) -> float:
        picture = _PICTURE if PNG in args else 0.0
        return seconds + picture + _reading(args) + per_byte * _bytes(args)

    return price


def _one(args: Sequence[Any], kind: type[T]) -> T:
    return next(one for one in args if isinstance(one, kind))


def _signature(args: Sequence[Any]) -> float:
    kind = _format(args[0]) if isinstance(args[0], Upload) else None
    picture = _PICTURE if PNG in args else 0.0
    return picture + signature_seconds(_bytes(args[:1]), _one(args, SignatureParameters), kind)


def _trade(args: Sequence[Any]) -> float:
    modes = SignatureParameters(modes=args[2])
    return _signature(args) + _WAYS_OF_TRADE * signature_seconds(_bytes(args[:1]), modes)


def _encoding(args: Sequence[Any]) -> float:
    target, size = _one(args, EncodingTarget), _bytes(args)
    to_size = 0.0 if target.bytes is None else _ENCODED_TO_SIZE * min(target.bytes, size)
    return _reading(args) + _ENCODED * size + to_size


def _superposed(args: Sequence[Any]) -> float:
    share = 1.0 if args[2] is None else max(1.0, len(args[2]) / _SURFACES_OF_SEQUENCE)
    text = _PICTURE if args[1] == SurfaceFormat.PLY else 0.0
    return text + _reading(args) + share * _SURFACE * _bytes(args)


def _modes(args: Sequence[Any]) -> float:
    return _USUAL(args) + _MODE * _one(args, ModesRequest).modes * _bytes(args)


def _tabulating(args: Sequence[Any]) -> float:
    signed, _records, kept, *_ = args
    read = sum(_READ(each) for each in zip(signed, kept, strict=True) if each[1])
    return _reading(args) + _PACKED * len(signed) + read


def _recordings(args: Sequence[Any]) -> float:
    return sum(_PACKED + _READ((one.vertices, one.signature)) for one in args[0])


def _asked_norm(args: Sequence[Any]) -> float:
    many = len(args[0]) >= FEWEST_RECORDINGS
    return _recordings(args) + (_COMPARED_COHORT if many else _reading(args[1:]))


def _measured(args: Sequence[Any]) -> float:
    answers = args[2]
    case = _COMPARED if len(answers) > 1 else _CASE
    return _PICTURE + _reading(args) + case * len(answers[0])


def _tracking(args: Sequence[Any]) -> float:
    modes, size = _one(args, TrackParameters).modes, _bytes(args[:1])
    if isinstance(args[0], Path):
        return _TRACK + _TRACKED_IMAGES * (1.0 + (modes / USUAL_MODES) ** 2) * size
    return _TRACK + _reading(args) + (_OF_POINTS + _OF_TRACKED_MODES * modes**2) * size


_USUAL: Final = _rule()
_READ: Final = _rule(per_byte=_READ_OUT)
_DRAWN: Final = _rule(_PICTURE)
_SHOWN: Final = _rule(_PICTURE, _READ_OUT + _SURFACE)

_RULES: Final[dict[Callable[..., Any], Rule]] = {
    **dict.fromkeys((sequences.ingest, sequences.restated, sequences.sample), _USUAL),
    sequences.show_template: _USUAL,
    sequences.make_template: _signature,
    sequences.modes_of_template: _modes,
    sequences.encode_sequence: _encoding,
    sequences.decode_upload: _rule(per_byte=_DECODED),
    signatures.sign: _signature,
    signatures.sign_upload: _signature,
    signatures.render: _USUAL,
    signatures.signature_as: _USUAL,
    signatures.compare_signatures: _USUAL,
    signatures.kinds_of: _USUAL,
    signatures.pack_npz: lambda args: _reading(args) + _PACKED * len(args[0]),
    signatures.pack_hdf5: lambda args: _reading(args) + _PACKED * len(args[0]),
    signatures.pack_archive: lambda args: _reading(args) + _PACKED * len(args[1]),
    signatures.tabulate_archive: lambda args: _reading(args) + _PACKED * len(args[1]),
    signatures.tabulate: _tabulating,
    derived.read_out: _READ,
    derived.measure_trade: _trade,
    derived.superpose: _superposed,
    derived.make_report: _rule(_PICTURE, _READ_OUT),
    derived.make_dicom: _rule(_DICOM, _READ_OUT),
    derived.make_view: _SHOWN,
    derived.make_frames: _SHOWN,
    tracks.ingest_images: _rule(_TRACK, _IMAGES),
    tracks.follow: _tracking,
    tracks.show_slices: _USUAL,
    tracks.show_track: _rule(per_byte=_IMAGES),
    classification.name_class: _USUAL,
    classification.classify_upload: _signature,
    classification.draw_card: _DRAWN,
    classification.measure: _measured,
    classification.held_out_ids: _USUAL,
    classification.held_out_table: _USUAL,
    classification.make_norm: lambda args: _PICTURE + _recordings(args),
    classification.ask_norm: _asked_norm,
    classification.tabulate_features: lambda args: _TABLE + _reading(args) + _PACKED * len(args[0]),
}
