"""What worker processes do. Tasks carry paths and small values, and may run twice.

Whatever parses an upload, or opens a file whose size a user chose, happens here and never in
the server's own process.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.body_frame import Components
from modalmotion.clinical import clinical_readouts, volume_figure
from modalmotion.codec import decode, encode
from modalmotion.comparison import Comparison, compare
from modalmotion.formats import (
    ParserHere,
    ReadLimits,
    ReadOptions,
    ReadResult,
    read_sequence,
    write_npz,
    write_raw,
    write_vtkhdf,
)
from modalmotion.sequence import MeshSequence
from modalmotion.signature import (
    ModalSignature,
    SignatureParameters,
    modal_signature,
    resolve_template,
)
from modalmotion.stopwatch import Stopwatch
from modalmotion.store import (
    SequenceRecord,
    record_of,
    sequence_from_hdf5,
    sequence_to_hdf5,
    signature_from_hdf5,
    signature_to_hdf5,
    template_from_hdf5,
    template_to_hdf5,
    write_pack,
)
from modalmotion.store.atomic import temporary_beside
from modalmotion.superposed import SurfaceFormat, write_superposed
from modalmotion.template import Template
from modalmotion.template_cache import TemplateCache
from modalmotion.tradeoff import measure_tradeoff
from modalmotion.tradeoff.plain import as_plain
from modalmotion_service.negotiation import HDF5, JSON, NPZ, PNG, RAW, VTKHDF
from modalmotion_service.schemas import (
    EncodedAnswer,
    EncodingTarget,
    ReadingAnswer,
    ReadoutsAnswer,
    SignatureAnswer,
    TemplateAnswer,
    TradeoffAnswer,
)
from modalmotion_service.task_progress import ProgressFile

# Templates and factored modes that a worker holds on to, each.
_KEPT_BYTES: Final = 32_000_000


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that is there as a whole or not at all.

    A worker that is thought lost may still be at the same work as the one in its place.
    """
    temporary = temporary_beside(path)
    temporary.write_bytes(data)
    temporary.replace(path)


@dataclass(frozen=True)
class Ingested:
    """An upload that was understood.

    Parameters
    ----------
    record : SequenceRecord
        Of the sequence; whose it is and when it came is for the server to say.
    reading : ReadingAnswer
        What the file held besides.
    milliseconds : dict
        By stage.
    """

    record: SequenceRecord
    reading: ReadingAnswer
    milliseconds: dict[str, float]


def ingest(upload: Path, options: ReadOptions, image: Path) -> Ingested:
    """Read an upload, check it, and write it as a sequence's HDF5 image."""
    watch = Stopwatch()
    with watch.stage("read"):
        read = _read(upload, options)
    with watch.stage("image"):
        record = record_of(read.sequence, created="", has_upload=True)
        write_whole(image, sequence_to_hdf5(read.sequence))
    return Ingested(record, ReadingAnswer.of(read), watch.milliseconds)


def sign(
    sequence: Path, parameters: SignatureParameters, template: Path | None, image: Path
) -> dict[str, float]:
    """Fit a kept sequence and write its signature's HDF5 image; gives milliseconds by stage."""
    watch = Stopwatch()
    with watch.stage("load"):
        loaded = sequence_from_hdf5(sequence)
        named = _named(template)
    with watch.stage("fit"):
        signature = modal_signature(loaded, parameters, template=named, cache=_cache_for(named))
    with watch.stage("image"):
        write_whole(image, signature_to_hdf5(signature))
    return watch.milliseconds


def sign_upload(
    upload: Path,
    options: ReadOptions,
    parameters: SignatureParameters,
    template: Path | None,
    media_type: str,
) -> tuple[bytes, dict[str, float]]:
    """Fit an upload and write its signature out; gives milliseconds by stage besides."""
    watch = Stopwatch()
    with watch.stage("read"):
        sequence = _read(upload, options).sequence
        named = _named(template)
    with watch.stage("fit"):
        signature = modal_signature(sequence, parameters, template=named, cache=_cache_for(named))
    with watch.stage("render"):
        body = _SIGNATURE_WRITERS[media_type](signature)
    return body, watch.milliseconds


def signature_as_json(path: Path, file: str) -> bytes:
    """Write a kept signature out as the service's JSON."""
    return SignatureAnswer.of(signature_from_hdf5(path), file).model_dump_json().encode()


@dataclass(frozen=True)
class Templated:
    """A template that was made of an upload.

    Parameters
    ----------
    answer : TemplateAnswer
    milliseconds : dict
        By stage.
    """

    answer: TemplateAnswer
    milliseconds: dict[str, float]


def make_template(
    upload: Path, options: ReadOptions, parameters: SignatureParameters, image: Path
) -> Templated:
    """Make the template of an upload's reference frame and write its HDF5 image."""
    watch = Stopwatch()
    with watch.stage("read"):
        sequence = _read(upload, options).sequence
    with watch.stage("template"):
        template = resolve_template(sequence, parameters)
    with watch.stage("image"):
        write_whole(image, template_to_hdf5(template))
    return Templated(TemplateAnswer.of(template), watch.milliseconds)


def compare_signatures(a: Path, b: Path, closed: bool) -> Comparison:
    """Compare two kept signatures."""
    return compare(signature_from_hdf5(a), signature_from_hdf5(b), closed=closed)


def describe_template(path: Path) -> TemplateAnswer:
    """Say what a kept template holds."""
    return TemplateAnswer.of(template_from_hdf5(path))


def draw_template(path: Path) -> bytes:
    """Draw s and theta on a kept template's surface, as PNG."""
    from modalmotion.template.picture import template_figure

    buffer = io.BytesIO()
    template_figure(template_from_hdf5(path)).savefig(buffer, format="png")
    return buffer.getvalue()


def read_out(sequence: Path, signature: Path, template: Path | None, as_picture: bool) -> bytes:
    """Read volume and ejection fraction from a kept signature, as JSON or as PNG."""
    found = clinical_readouts(
        signature_from_hdf5(signature),
        sequence_from_hdf5(sequence),
        template=None if template is None else template_from_hdf5(template),
    )
    if not as_picture:
        return ReadoutsAnswer.of(found).model_dump_json().encode()
    buffer = io.BytesIO()
    volume_figure(found).savefig(buffer, format="png")
    return buffer.getvalue()


def measure_trade(
    sequence: Path,
    parameters: SignatureParameters,
    front_modes: int,
    components: Components | None,
    template: Path | None,
    media_type: str,
    output: Path,
) -> dict[str, float]:
    """Measure the trade on a kept sequence, as JSON or PNG; gives milliseconds by stage."""
    found = measure_tradeoff(
        sequence_from_hdf5(sequence),
        parameters,
        most_modes=front_modes,
        components=None if components is None else (components,),
        template=None if template is None else template_from_hdf5(template),
    )
    if media_type == PNG:
        from modalmotion.tradeoff.picture import tradeoff_figure

        tradeoff_figure(found).savefig(output, format="png")
    else:
        output.write_text(TradeoffAnswer(**as_plain(found)).model_dump_json())
    return dict(found.milliseconds)


def superpose(
    sequence: Path,
    signature: Path,
    template: Path | None,
    surface_format: SurfaceFormat,
    times: list[float] | None,
    max_targets: int | None,
    output: Path,
) -> None:
    """Write the surfaces that a kept signature stands for."""
    write_whole(
        output,
        write_superposed(
            signature_from_hdf5(signature),
            sequence_from_hdf5(sequence),
            surface_format,
            template=None if template is None else template_from_hdf5(template),
            times=None if times is None else np.array(times),
            max_targets=max_targets,
        ),
    )


def encode_upload(
    upload: Path, options: ReadOptions, asked: EncodingTarget, output: Path, progress: Path
) -> EncodedAnswer:
    """Read an upload and write it as a compressed stream; `progress` is a `ProgressFile`."""
    return _encoded(_read(upload, options).sequence, asked, output, progress)


def encode_kept(
    sequence: Path, asked: EncodingTarget, output: Path, progress: Path
) -> EncodedAnswer:
    """Write a kept sequence as a compressed stream; `progress` is a `ProgressFile`."""
    return _encoded(sequence_from_hdf5(sequence), asked, output, progress)


def decode_upload(
    upload: Path, limits: ReadLimits, frames: range | None, media_type: str, output: Path
) -> None:
    """Decode a compressed stream and write its sequence: npz, VTKHDF or raw float32."""
    sequence = decode(upload.read_bytes(), frames=frames, limits=limits)
    write = {NPZ: write_npz, VTKHDF: write_vtkhdf, RAW: write_raw}[media_type]
    write_whole(output, write(sequence))


def _encoded(
    sequence: MeshSequence, asked: EncodingTarget, output: Path, progress: Path
) -> EncodedAnswer:
    found = encode(
        sequence,
        rms=asked.rms,
        max_error=asked.max_error,
        n_bytes=asked.bytes,
        effort=asked.effort,
        progress=ProgressFile(progress).write,
    )
    write_whole(output, found.data)
    return EncodedAnswer.of(found)


def pack_npz(signatures: list[Path], records: list[SequenceRecord], output: Path) -> None:
    """Pack the trajectories of many signatures into one .npz archive.

    Arrays `ids`, `labels` (of the classes, as users say), and for each signature by its number
    `amplitudes_0`, `modes_0`, `angular_frequencies_0`, `rms_errors_0` and `times_0`.
    """
    arrays: dict[str, Any] = {
        "ids": np.array([record.id for record in records]),
        "labels": np.array([record.label or "" for record in records]),
    }
    for number, path in enumerate(signatures):
        named = _trajectory(signature_from_hdf5(path)).items()
        arrays.update({f"{name}_{number}": array for name, array in named})
    with output.open("wb") as file:
        np.savez(file, **arrays)


def pack_hdf5(signatures: list[Path], records: list[SequenceRecord], output: Path) -> None:
    """Pack the trajectories of many signatures into one HDF5 file, laid out as an export."""
    loaded = map(signature_from_hdf5, signatures)
    write_pack(output, zip(loaded, records, strict=True))


def _read(upload: Path, options: ReadOptions) -> ReadResult:
    # This process may be lost and is limited from outside: parsers need none of their own.
    return read_sequence(upload.read_bytes(), options, parser=ParserHere(options.limits))


@lru_cache(maxsize=1)
def _kept() -> TemplateCache:
    """Give what this process has made ready for cohorts that name a template."""
    return TemplateCache(most_bytes=_KEPT_BYTES)


def _named(template: Path | None) -> Template | None:
    if template is None:
        return None
    # The path ends with the template's id, which stands for its content.
    return _kept().named(template.name, lambda: template_from_hdf5(template))


def _cache_for(template: Template | None) -> TemplateCache | None:
    # A sequence's own template is seldom asked for again.
    return None if template is None else _kept()


def _as_json(signature: ModalSignature) -> bytes:
    return SignatureAnswer.of(signature, None).model_dump_json().encode()


def _as_npz(signature: ModalSignature) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **_trajectory(signature))
    return buffer.getvalue()


def _as_raw(signature: ModalSignature) -> bytes:
    return signature.amplitudes.astype("<f4").tobytes()


_SIGNATURE_WRITERS: Final = {
    JSON: _as_json,
    HDF5: signature_to_hdf5,
    NPZ: _as_npz,
    RAW: _as_raw,
}


def _trajectory(signature: ModalSignature) -> dict[str, Any]:
    arrays: dict[str, Any] = {
        "amplitudes": signature.amplitudes,
        "modes": np.array([str(label) for label in signature.modes.labels]),
        "angular_frequencies": signature.angular_frequencies,
        "rms_errors": signature.rms_errors,
    }
    if signature.times is not None:
        arrays["times"] = signature.times
    return arrays
