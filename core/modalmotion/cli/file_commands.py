"""Commands of files: show, convert, tabulate, encode and decode."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import click

from modalmotion import clinical, errors, formats, notes, store
from modalmotion.cli import shared
from modalmotion.cli.files import (
    Waiting,
    counting,
    each_labelled,
    fitted,
    naming,
    read,
    sequence_argument,
    stated_facts,
)
from modalmotion.exports.files import SURFACES, save
from modalmotion.formats.detect import STREAM
from modalmotion.hdf5 import image, sealed

if TYPE_CHECKING:
    from modalmotion.classification import TrainingCase
    from modalmotion.clinical import ClinicalReadouts
    from modalmotion.clinical.ventricle import VentricleReadouts
    from modalmotion.exports.tables import Table
    from modalmotion.mesh.sequence import MeshSequence
    from modalmotion.signature.making import ModalSignature, SignatureParameters


@shared.command("encode beat.npz -o beat.mms --max-error 0.1")
@sequence_argument
def encode(
    source: Path,
    output: Annotated[Path, shared.OutputFile()],
    rms: float | None = None,
    max_error: float | None = None,
    n_bytes: Annotated[int | None, {"flag": "bytes"}] = None,
    effort: Literal["fast", "balanced"] = "balanced",
    **options: Any,
) -> Any:
    """Compress the sequence in FILE at a given error (in its unit) or size.

    Without either, the largest error is 0.3 % of the diagonal of its bounding box.

    Parameters
    ----------
    output
        Stream to write.
    rms
        Largest RMS distance of the vertices, in their unit.
    max_error
        Largest error of any vertex, in its unit.
    n_bytes
        Largest size of the stream.
    effort
        Number of transforms tried: fast takes a third of the time and more bits.
    """
    from modalmotion.codec import encode as compress

    sequence = read(source, **options)
    with counting("encode") as show:
        stream = compress(
            sequence,
            rms=rms,
            max_error=max_error,
            n_bytes=n_bytes,
            effort=effort,
            progress=show,
        )
    store.write_atomic(output, stream.data)
    names = ("n_bytes", "bits_per_vertex_and_frame", "rms", "max_error", "transform")
    found = shared.members(stream, *names, "kg_error as kg_error_percent")
    return {**found, "unit": sequence.unit}


@shared.command("decode beat.mms -o beat.npz")
@click.argument("stream", type=shared.EXISTING_FILE)
def decode(
    stream: Path,
    output: Annotated[Path, shared.OutputFile(*SURFACES)],
    first: int | None = None,
    stop: int | None = None,
) -> Any:
    """Decode a compressed STREAM, or some of its frames.

    Parameters
    ----------
    output
        File to write: .npz, .h5, .vtkhdf, .glb, .zip (PLY) or .raw (float32).
    first
        First frame.
    stop
        Frame after the last.
    """
    from modalmotion.codec import decode as expand
    from modalmotion.codec import inspect

    data = stream.read_bytes()
    with naming(stream):
        n_frames = inspect(data).n_frames
    frames = range(first or 0, n_frames if stop is None else stop)
    sequence = expand(data, frames=frames)
    save(sequence, output)
    return shared.members(sequence, *shared.SEQUENCE)


@shared.command("convert frames/ beat.vtkhdf --unit mm")
@sequence_argument
@click.argument("output", metavar="OUT", type=shared.OutputFile(*SURFACES))
def convert(source: Path, output: Path, **options: Any) -> Any:
    """Write the sequence in FILE in another format.

    The suffix chooses it: .npz, .h5, .vtkhdf, .glb, .zip (PLY) or .raw.

    FILE is a file of any known format, a folder of frames, or a pattern of their names in quotes.
    """
    sequence = read(source, **options)
    save(sequence, output)
    return shared.members(sequence, *shared.SEQUENCE)


_SEQUENCE: Final = (
    "n_frames as frames",
    "n_vertices as vertices",
    "faces as triangles",
    *("topology", "grid", "span as seconds", "unit", "facts", "id"),
)
_SHOWN: Final = {
    "sequence": _SEQUENCE,
    "track": tuple(f"sequence.{one}" for one in _SEQUENCE),
    "signature": (
        *("surface", "n_frames as frames", "n_vertices as vertices", "modes"),
        *("n_amplitudes as amplitudes_per_frame", "parameters.components", "unit", "rms_error"),
        *("max_error", "sequence_id", "template_id", "notes"),
    ),
    "template": ("topology as surface", "n_vertices as vertices", "lengths", "id", "notes"),
    "model": ("name", "classes", "card.n_cases as cases", "card.accuracy", "readable.n_modes"),
    "classification": ("label", "probability", "class_set", "model", "sequence_id", "notes"),
    "norm": ("name", "n_controls", "readable.n_modes", "id", "notes"),
    "compressed sequence": (
        *("n_frames", "n_vertices", "n_faces", "topology", "grid", "unit", "rms", "max_error"),
    ),
}
"""Attributes by kind of file, and their names where these are others."""


@shared.command("show beat.h5")
@click.argument("file", metavar="FILE", type=shared.EXISTING)
def show(file: Path) -> Any:
    """Show what is in FILE.

    FILE is a signature, sequence, track, template, class, model or stream of modalmotion; a moving
    surface in any known format, as a file or a folder of frames; or images.
    """
    head = b""
    if file.is_file():
        with file.open("rb") as opened:
            head = opened.read(len(sealed.SIGNATURE))
    if head.startswith(STREAM):
        from modalmotion.codec.decoder import inspect

        with naming(file):
            header = inspect(file.read_bytes())
        return {**_shown("compressed sequence", header), "bytes": file.stat().st_size}
    if head == sealed.SIGNATURE:
        kind = ""
        # HDF5 of other programs has none.
        with contextlib.suppress(errors.StoreError):
            kind = image.form_of(file).kind
        if kind in _SHOWN:
            from modalmotion.exports.files import load

            return _shown(kind, load(file))
        if kind:
            return {"content": kind, "bytes": file.stat().st_size}
    from modalmotion.formats.volumes.reading import holds_images

    if holds_images(file):
        return _images(file)
    try:
        reading = formats.read_sequence(file)
    except errors.InputError as error:
        raise click.ClickException(
            f"{file.name} is neither a file of modalmotion nor a moving surface: {error}"
        ) from error
    return {
        **_shown("sequence", reading.sequence),
        "content": "moving surface",
        "format": reading.format,
        "ignored": list(reading.ignored),
        "notes": notes.notes_as_json(reading.notes),
    }


def _images(file: Path) -> dict[str, Any]:
    """Describe images; of a label map the labels of its first frame, with their volumes."""
    from modalmotion.formats.volumes import read_images
    from modalmotion.images import Volume
    from modalmotion.tracking.label_values import is_label_map, values_in

    with naming(file):
        images = read_images(file)
    first = next(frame for frame in images.frames if frame is not None)
    content = {"content": "images", "frames": images.n_frames, "period": images.period}
    if isinstance(first, Volume):
        content |= {"voxels": list(first.shape), "spacing": [round(s, 3) for s in first.spacing]}
    else:
        content["planes"] = len(first)
    if isinstance(first, Volume) and is_label_map(images):
        content |= {"content": "label map", "labels": values_in(first)}
    return content | {"notes": notes.notes_as_json(images.notes)}


def _shown(kind: str, value: Any) -> dict[str, Any]:
    return {"content": kind, **shared.members(value, *_SHOWN[kind], write=_plain)}


def _plain(value: Any) -> Any:
    """Give a value as JSON has it; of sets of modes and of arrays their number."""
    if value is None or isinstance(value, int | float | str):
        return value
    if isinstance(value, tuple):
        return list(value)
    if isinstance(value, dict):
        return sum(value.values())
    return len(value) if hasattr(value, "__len__") else str(value)


@shared.command("table beat.npz --frames -o frames.csv", prints_json=False)
@sequence_argument
@shared.fit_options
def table(
    source: Path,
    output: Annotated[Path | None, shared.OutputFile(".csv")] = None,
    frames: bool = False,
    skip_unreadable: bool = False,
    **options: Any,
) -> None:
    """Write amplitudes of the sequence in FILE as CSV: a row for each frame, mode and direction.

    Where FILE is a manifest (.csv, with the column path and, where they are known, label, subject
    and facts), each of its recordings has a row: errors, volumes, ejection fraction, amplitudes.

    Parameters
    ----------
    output
        CSV file to write; printed by default.
    frames
        One row per frame instead of per amplitude: motion and error, volume in ml, inward
        motion of each segment and strain in percent.
    skip_unreadable
        For a manifest: continue without recordings that cannot be used; they are named.
    """
    from modalmotion.exports.tables import amplitude_table

    if source.suffix.lower() in (".csv", ".tsv"):
        if frames:
            raise click.UsageError("--frames is for one sequence, and not for a manifest.")
        parameters = shared.signature_parameters(options)
        _write(_cohort(source, parameters, skip_unreadable, options).to_csv(), output)
        return
    with Waiting(source) as waiting:
        sequence, signature = fitted(source, waiting, options)
        with waiting.watch.stage("table"):
            made = _frames(signature, sequence) if frames else amplitude_table(signature)
            text = made.to_csv()
    _write(text, output)


def _write(text: str, output: Path | None) -> None:
    if output is None:
        click.echo(text, nl=False)
    else:
        store.write_atomic(output, text.encode())


def _cohort(
    manifest: Path, parameters: SignatureParameters, skips: bool, stated: dict[str, Any]
) -> Table:
    """Tabulate the recordings of a manifest; those that are left out are named."""
    from modalmotion.exports.tables import Recording, cohort_table
    from modalmotion.signature.making import modal_signature

    def recording(case: TrainingCase) -> Recording:
        sequence: Any = case.motion
        signature = modal_signature(sequence, parameters)
        readouts: ClinicalReadouts | None = None
        with contextlib.suppress(errors.InputError):
            readouts = clinical.clinical_readouts(signature, sequence)
        return Recording(case.name, signature, readouts, case.subject, case.label or None)

    facts = stated_facts(stated)
    made, left_out = each_labelled([manifest], recording, skips=skips, facts=facts, **stated)
    for one in left_out:
        click.echo(f"left out: {one}", err=True)
    if not made:
        raise errors.ParameterError(
            f"No recording of '{manifest}' can be tabulated.",
            remedy="Name files that can be read in its column path.",
        )
    return cohort_table(made)


def _frames(signature: ModalSignature, sequence: MeshSequence) -> Table:
    """Tabulate frames, with all that this surface has."""
    from modalmotion.clinical.ventricle import ventricle_readouts
    from modalmotion.exports.tables import frame_table

    readouts: ClinicalReadouts | None = None
    ventricle: VentricleReadouts | None = None
    try:
        readouts = clinical.clinical_readouts(signature, sequence)
    except errors.InputError as error:
        click.echo(f"note: {error}", err=True)
    else:
        ventricle = ventricle_readouts(signature, sequence, readouts)
        for reason in ventricle.reasons:
            click.echo(f"note: {reason}", err=True)
    return frame_table(signature, readouts, ventricle)
