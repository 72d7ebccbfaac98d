"""What tasks cost: processor time of an honest file of that size, known before it is read."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import InputError
from modalmotion.exports.signature_pack import SurfaceFormat
from modalmotion.formats.detect import Format, detect_format
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.predicted_time import (
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
from modalmotion_service.work.tasks.classification import KeptRecording
from modalmotion_service.work.tasks.files import Fitted
from modalmotion_service.work.upload import Upload

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


class Tariff:
    """The terms of one owner's tasks.

    Parameters
    ----------
    owner : str
    factor : float
        Most processor time of a task, in multiples of its price.
    least_seconds : float, s
        Processor time that every task may take.
    """

    def __init__(self, owner: str, factor: float, least_seconds: float) -> None:
        self._owner = owner
        self._factor = factor
        self._least_seconds = least_seconds

    def terms(self, task: Callable[..., Any], args: Sequence[Any]) -> Terms:
        """Give the terms of a task with these arguments."""
        rule = _RULES.get(task)
        price = math.inf if rule is None else rule(args)
        # Of a surface that turns out to have no natural coordinates.
        dear = price + spring_seconds(_bytes(args), _modes_of(args))
        return Terms(self._owner, price, max(self._least_seconds, self._factor * dear))


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


def _signature(args: Sequence[Any]) -> float:
    parameters = next(one for one in args if isinstance(one, SignatureParameters))
    kind = _format(args[0]) if isinstance(args[0], Upload) else None
    picture = _PICTURE if PNG in args else 0.0
    return picture + signature_seconds(_bytes(args[:1]), parameters, kind)


def _trade(args: Sequence[Any]) -> float:
    modes = SignatureParameters(modes=args[2])
    largest = signature_seconds(_bytes(args[:1]), modes)
    return _signature(args) + _WAYS_OF_TRADE * largest + (_PICTURE if PNG in args else 0.0)


def _encoding(args: Sequence[Any]) -> float:
    target = next(one for one in args if isinstance(one, EncodingTarget))
    size = _bytes(args)
    to_size = 0.0 if target.bytes is None else _ENCODED_TO_SIZE * min(target.bytes, size)
    return _reading(args) + _ENCODED * size + to_size


def _read_out(args: Sequence[Any]) -> float:
    picture = _PICTURE if PNG in args else 0.0
    return picture + _reading(args) + _READ_OUT * _bytes(args)


def _shown(args: Sequence[Any]) -> float:
    return _PICTURE + _reading(args) + (_READ_OUT + _SURFACE) * _bytes(args)


def _superposed(args: Sequence[Any]) -> float:
    times = args[2]
    share = 1.0 if times is None else max(1.0, len(times) / _SURFACES_OF_SEQUENCE)
    text = _PICTURE if args[1] == SurfaceFormat.PLY else 0.0
    return text + _reading(args) + share * _SURFACE * _bytes(args)


def _modes(args: Sequence[Any]) -> float:
    query = next(one for one in args if isinstance(one, ModesRequest))
    picture = _PICTURE if PNG in args else 0.0
    return picture + _reading(args) + _MODE * query.modes * _bytes(args)


def _picture(args: Sequence[Any]) -> float:
    return _PICTURE + _reading(args)


def _packing(args: Sequence[Any]) -> float:
    return _reading(args) + _PACKED * len(args[0])


def _tabulating(args: Sequence[Any]) -> float:
    signed, _records, kept, *_ = args
    read = sum(_read_out((v, s)) for s, v in zip(signed, kept, strict=True) if v)
    return _packing(args) + read


def _recording(one: KeptRecording) -> float:
    return _PACKED + _read_out((one.vertices, one.signature))


def _tracking(args: Sequence[Any]) -> float:
    parameters = next(one for one in args if isinstance(one, TrackParameters))
    modes = parameters.modes
    of_byte = _OF_POINTS + _OF_TRACKED_MODES * modes**2
    if isinstance(args[0], Path):
        return _TRACK + _TRACKED_IMAGES * (1.0 + (modes / USUAL_MODES) ** 2) * _bytes(args[:1])
    return _TRACK + _reading(args) + of_byte * _bytes(args[:1])


_RULES: Final[dict[Callable[..., Any], Callable[[Sequence[Any]], float]]] = {
    sequences.ingest: _reading,
    sequences.restated: _reading,
    sequences.sample: _reading,
    signatures.sign: _signature,
    signatures.sign_upload: _signature,
    signatures.render: _reading,
    signatures.signature_as: lambda args: (_PICTURE if PNG in args else 0.0) + _reading(args),
    signatures.compare_signatures: _reading,
    signatures.pack_npz: _packing,
    signatures.pack_hdf5: _packing,
    signatures.tabulate: _tabulating,
    signatures.pack_archive: lambda args: _reading(args) + _PACKED * len(args[1]),
    signatures.tabulate_archive: lambda args: _reading(args) + _PACKED * len(args[1]),
    sequences.make_template: _signature,
    sequences.describe_template: _reading,
    sequences.draw_template: _picture,
    sequences.modes_of_template: _modes,
    classification.name_class: _reading,
    classification.classify_upload: _signature,
    classification.draw_card: _picture,
    classification.measure: lambda args: _picture(args) + _CASE * len(args[2]),
    classification.compare: lambda args: _picture(args) + _COMPARED * len(args[2][0]),
    classification.held_out_ids: _reading,
    classification.held_out_table: _reading,
    signatures.kinds_of: _reading,
    sequences.encode_upload: _encoding,
    sequences.encode_kept: _encoding,
    sequences.decode_upload: lambda args: _reading(args) + _DECODED * _bytes(args),
    derived.read_out: _read_out,
    derived.measure_trade: _trade,
    derived.superpose: _superposed,
    derived.make_report: lambda args: _PICTURE + _read_out(args),
    derived.make_dicom: lambda args: _DICOM + _read_out(args[:1]),
    derived.make_view: _shown,
    derived.make_frames: _shown,
    tracks.ingest_images: lambda args: _TRACK + _IMAGES * _bytes(args),
    tracks.show_slices: _reading,
    tracks.follow: _tracking,
    tracks.describe_track: _reading,
    tracks.track_with_facts: _reading,
    tracks.draw_track: _picture,
    tracks.show_data: _reading,
    tracks.draw_overlay: lambda args: _picture(args) + _IMAGES * _bytes(args),
    classification.make_norm: lambda args: _PICTURE + sum(map(_recording, args[0])),
    classification.ask_norm: lambda args: (
        (_COMPARED_COHORT if len(args[0]) >= classification.LEAST_TOGETHER else _reading(args[1:]))
        + sum(map(_recording, args[0]))
    ),
    classification.tabulate_features: lambda args: _TABLE + _packing(args),
}
