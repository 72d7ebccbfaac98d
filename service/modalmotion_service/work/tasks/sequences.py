"""Sequences read, encoded and decoded, and their templates."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion import codec, errors, simulate, store
from modalmotion.exports.animation import modes_to_hdf5, modes_to_npz
from modalmotion.formats import ReadLimits, write_npz, write_raw, write_vtkhdf
from modalmotion.mesh.facts import Facts
from modalmotion.progress import Stopwatch, part_of
from modalmotion.signature.making import SignatureParameters, resolve_parameters, resolve_template
from modalmotion.template.vibration_modes import surface_modes
from modalmotion_service.http.negotiation import HDF5, NPZ, PNG, RAW, VTKHDF
from modalmotion_service.schemas import general, queries, requests, results, signatures
from modalmotion_service.work.tasks.files import ProgressFile, png_of, write_whole
from modalmotion_service.work.upload import Upload

# Parts of the whole; the rest is for the server.
_SHARES: Final = {"read": 0.7, "image": 0.2}


def ingest(
    upload: Upload, image: Path, progress: Path
) -> tuple[store.SequenceRecord, general.ReadingAnswer]:
    """Read an upload, check it, and write it as a sequence's HDF5 image.

    `progress` is a `ProgressFile`.

    Returns
    -------
    record : SequenceRecord
        Of the sequence; whose it is and when it came is for the server to say.
    reading : ReadingAnswer
        What the file held besides.
    """
    watch = Stopwatch(_SHARES, ProgressFile(progress).write)
    with watch.stage("read") as report:
        reading = upload.read(report)
    with watch.stage("image"):
        record = store.record_of(reading.sequence, created="", has_upload=True)
        write_whole(image, store.upload_image(reading.sequence))
    return record, general.ReadingAnswer.of(reading)


def sample(image: Path) -> store.SequenceRecord:
    """Simulate a healthy left ventricle and write it as a sequence's HDF5 image."""
    beat = simulate.simulate_ventricle(
        grid=(24, 48), acquisition=simulate.Acquisition(noise=0.3), rng=np.random.default_rng(1994)
    )
    write_whole(image, store.upload_image(beat))
    return store.record_of(beat, created="", has_upload=True)


def restated(
    path: Path,
    track: Path | None,
    stated: Mapping[str, Any],
    facts: Facts,
    sequence_image: Path,
    track_file: Path,
) -> store.SequenceRecord:
    """Write a kept sequence with another unit or other times, and its track where there is one.

    Parameters
    ----------
    path : Path
        Of the sequence.
    track : Path or None
    stated : mapping
        Of "unit" and "times" those that change; None makes one unknown.
    facts : Facts
        Of the sequence as it will be: they have to go with the times.
    sequence_image, track_file : Path
        Where to write.
    """
    made = None if track is None else store.track_from_hdf5(track)
    sequence = store.sequence_from_hdf5(path) if made is None else made.sequence
    if "unit" in stated:
        unit = stated["unit"]
        sequence = replace(sequence, unit=None) if unit is None else sequence.with_unit(unit)
    if "times" in stated:
        sequence = sequence.with_times(stated["times"])
    sequence.with_facts(facts)
    if made is not None:
        write_whole(track_file, store.track_image(replace(made, sequence=sequence)))
    write_whole(sequence_image, store.upload_image(sequence))
    return store.record_of(sequence, created="", has_upload=True)


def encode_sequence(
    source: Upload | Path, target: requests.EncodingTarget, output: Path, progress: Path
) -> results.EncodedAnswer:
    """Write an upload or a kept sequence as a compressed stream; `progress` is a `ProgressFile`."""
    found = codec.encode(
        store.sequence_from_hdf5(source) if isinstance(source, Path) else source.read().sequence,
        rms=target.rms,
        max_error=target.max_error,
        n_bytes=target.bytes,
        effort=target.effort,
        progress=part_of(ProgressFile(progress).write, 0.0, 1.0, "encoding"),
    )
    write_whole(output, found.data)
    return results.EncodedAnswer.of(found)


def decode_upload(
    upload: Path,
    limits: ReadLimits,
    frames: range | None,
    media_type: str,
    output: Path,
) -> None:
    """Decode a compressed stream and write its sequence: npz, VTKHDF or raw float32."""
    sequence = codec.decode(upload.read_bytes(), frames=frames, limits=limits)
    write = {NPZ: write_npz, VTKHDF: write_vtkhdf, RAW: write_raw}[media_type]
    write_whole(output, write(sequence))


# Parts of the whole, of a large mesh; the rest is for the server.
_TEMPLATE_SHARES: Final = {"read": 0.2, "template": 0.65, "image": 0.1}

# Numbers of the shapes in one answer: 256 MB, and as text much more.
_MOST_NUMBERS: Final = 32_000_000
_MOST_NUMBERS_AS_JSON: Final = 2_000_000


def make_template(
    upload: Upload, parameters: SignatureParameters, image: Path, progress: Path
) -> signatures.TemplateAnswer:
    """Make the template of an upload and write its HDF5 image.

    `progress` is a `ProgressFile`.
    """
    watch = Stopwatch(_TEMPLATE_SHARES, ProgressFile(progress).write)
    with watch.stage("read"):
        sequence = upload.read().sequence
    with watch.stage("template") as report:
        resolved = resolve_parameters(sequence, parameters)
        template = resolve_template(sequence, resolved, report=report)
    with watch.stage("image"):
        write_whole(image, store.template_to_hdf5(template))
    return signatures.TemplateAnswer.of(template)


def show_template(path: Path, media_type: str) -> bytes:
    """Describe a kept template, or draw s and theta on its surface."""
    template = store.template_from_hdf5(path)
    if media_type == PNG:
        from modalmotion.pictures.modes import template_figure

        return png_of(template_figure(template))
    return signatures.TemplateAnswer.of(template).model_dump_json().encode()


def modes_of_template(path: Path, query: queries.ModesRequest, media_type: str) -> bytes:
    """Give a kept template's vibration modes as JSON, npz, HDF5 or PNG."""
    template = store.template_from_hdf5(path)
    _require_room(template.n_vertices * query.modes, _MOST_NUMBERS)
    modes = surface_modes(template, query.modes, query.wave_speed)
    if media_type == PNG:
        from modalmotion.pictures.modes import modes_figure

        return png_of(modes_figure(template, modes))
    if media_type in (NPZ, HDF5):
        return (modes_to_npz if media_type == NPZ else modes_to_hdf5)(modes)
    if query.shapes:
        _require_room(modes.shapes.size, _MOST_NUMBERS_AS_JSON)
    return signatures.ModesAnswer.of(template, modes, query.shapes).model_dump_json().encode()


def _require_room(n_numbers: int, most: int) -> None:
    if n_numbers > most:
        raise errors.LimitError(
            f"The shapes of these modes are {n_numbers} numbers; one answer contains {most}.",
            remedy="Ask for fewer modes, or for npz or HDF5 in place of JSON.",
            limit="shapes",
            details={"value": n_numbers, "most": most},
        )
