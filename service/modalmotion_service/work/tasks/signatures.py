"""Signatures made, written out, compared and packed, of one file or many."""

from __future__ import annotations

import contextlib
import io
import json
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion import store
from modalmotion.clinical import clinical_readouts
from modalmotion.errors import InputError
from modalmotion.exports.signature_pack import write_pack
from modalmotion.exports.tables import Recording, Table, amplitude_table, cohort_table
from modalmotion.mesh.checks import single_precision
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Stopwatch
from modalmotion.signature.distance import Comparison, compare
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion_service.http.negotiation import CSV, HDF5, JSON, NPZ, PNG, RAW
from modalmotion_service.schemas.signatures import SignatureAnswer
from modalmotion_service.work.tasks.files import (
    Fitted,
    ProgressFile,
    loaded_sequence,
    named_template,
    png_of,
    whole_file,
    write_whole,
)
from modalmotion_service.work.upload import Part, Upload

# Parts of the whole, of a large mesh; the rest is for the server.
_SHARES: Final = {"load": 0.05, "template": 0.5, "fit": 0.3, "notes": 0.05, "image": 0.05}


def sign(
    sequence: Path,
    parameters: SignatureParameters,
    template: Path | None,
    track: Path | None,
    image: Path,
    progress: Path,
) -> tuple[dict[str, float]]:
    """Fit a kept sequence and write its signature's HDF5 image; gives milliseconds by stage.

    `track` is that of the sequence, where it has one: it says how far positions may be off.
    `progress` is a `ProgressFile`.
    """
    watch = Stopwatch(_SHARES, ProgressFile(progress).write)
    with watch.stage("load"):
        loaded = loaded_sequence(sequence, track)
        named = named_template(template)
    signature = modal_signature(loaded, parameters, template=named, watch=watch)
    with watch.stage("image"):
        write_whole(image, store.signature_image(signature))
    return (watch.milliseconds,)


def sign_upload(
    upload: Upload, parameters: SignatureParameters, template: Path | None, media_type: str
) -> tuple[bytes, dict[str, float]]:
    """Fit an upload and write its signature out; gives milliseconds by stage besides."""
    watch = Stopwatch()
    with watch.stage("read"):
        sequence = upload.read().sequence
        named = named_template(template)
    signature = modal_signature(sequence, parameters, template=named, watch=watch)
    with watch.stage("render"):
        if media_type == PNG:
            body = _as_png(signature, sequence)
        else:
            body = _SIGNATURE_WRITERS[media_type](signature)
    return body, watch.milliseconds


def render(path: Path, key: str | None, file: str | None) -> bytes:
    """Write a signature out as the service's JSON, without the facts of its sequence."""
    answer = SignatureAnswer.of(store.signature_from_hdf5(path), key, file)
    return answer.model_dump_json(exclude={"facts"}).encode()


def signature_as(one: Fitted, media_type: str) -> bytes:
    """Write a signature and the facts of its sequence out as a media type."""
    signature = one.read_signature()
    if media_type == PNG:
        return _as_png(signature, store.sequence_from_hdf5(one.sequence))
    return _SIGNATURE_WRITERS[media_type](signature)


def compare_signatures(a: Fitted, b: Fitted, closed: bool) -> Comparison:
    """Compare two signatures."""
    return compare(
        store.signature_from_hdf5(a.signature),
        store.signature_from_hdf5(b.signature),
        closed=closed,
    )


def kinds_of(signatures: list[Path]) -> list[tuple[str, str]]:
    """Topology of each signature, and of spring modes the mesh that they belong to."""
    loaded = map(store.signature_from_hdf5, signatures)
    return [(signature.surface, signature.modes.connectivity_id) for signature in loaded]


def pack_npz(signatures: list[Path], records: list[store.SequenceRecord], output: Path) -> None:
    """Pack the trajectories of many signatures into one .npz archive.

    Arrays `ids`, `labels` (of the classes, as users say), and for each signature by its number
    `amplitudes_0`, `modes_0`, `angular_frequencies_0`, `rms_errors_0`, `weighted_rms_errors_0`,
    and where they are known `amplitude_deviations_0` and `times_0`.
    """
    arrays: dict[str, Any] = {
        "ids": np.array([record.id for record in records]),
        "labels": np.array([record.label or "" for record in records]),
    }
    for number, path in enumerate(signatures):
        named = _trajectory(store.signature_from_hdf5(path)).items()
        arrays.update({f"{name}_{number}": array for name, array in named})
    with whole_file(output) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def pack_hdf5(signatures: list[Path], records: list[store.SequenceRecord], output: Path) -> None:
    """Pack the trajectories of many signatures into one HDF5 file, laid out as an export."""
    loaded = map(store.signature_from_hdf5, signatures)
    with whole_file(output) as temporary:
        write_pack(temporary, zip(loaded, records, strict=True))


def tabulate(
    signatures: list[Path],
    records: list[store.SequenceRecord],
    sequences: list[Path | None],
    template: Path | None,
    output: Path,
) -> None:
    """Write a table of many signatures, with what the volumes of their surfaces tell.

    Of a sequence whose vertices are not kept no volume is told.
    """
    rows, used = [], named_template(template)
    for path, record, sequence in zip(signatures, records, sequences, strict=True):
        signature = replace(store.signature_from_hdf5(path), facts=record.facts)
        readouts = None
        if sequence is not None:
            with contextlib.suppress(InputError):
                stated = store.sequence_from_hdf5(sequence).with_facts(record.facts)
                readouts = clinical_readouts(signature, stated, template=used)
        rows.append(Recording(record.id, signature, readouts, record.subject, record.label))
    write_whole(output, cohort_table(rows).to_csv().encode())


def _as_npz(signature: ModalSignature) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **_trajectory(signature))
    return buffer.getvalue()


def _as_png(signature: ModalSignature, sequence: MeshSequence) -> bytes:
    from modalmotion.pictures.signature import signature_figure

    return png_of(signature_figure(sequence, signature))


_SIGNATURE_WRITERS: Final[dict[str, Callable[[ModalSignature], bytes]]] = {
    JSON: lambda one: SignatureAnswer.of(one).model_dump_json().encode(),
    HDF5: store.signature_to_hdf5,
    NPZ: _as_npz,
    CSV: lambda one: amplitude_table(one).to_csv().encode(),
    RAW: lambda one: single_precision(one.amplitudes, "An amplitude").tobytes(),
}


def _trajectory(signature: ModalSignature) -> dict[str, Any]:
    arrays: dict[str, Any] = {
        "amplitudes": signature.amplitudes,
        "modes": np.array([str(label) for label in signature.modes.labels]),
        "angular_frequencies": signature.angular_frequencies,
        "rms_errors": signature.rms_errors,
        "weighted_rms_errors": signature.weighted_rms_errors,
    }
    if signature.amplitude_deviations is not None:
        arrays["amplitude_deviations"] = signature.amplitude_deviations
    if signature.times is not None:
        arrays["times"] = signature.times
    return arrays


RESULTS: Final = "results.json"
"""Member of an archive that says which file, or which problem, each result is."""


def pack_archive(archive: Path, parts: Sequence[Part], output: Path) -> None:
    """Pack the signatures of an archive into one HDF5 file, laid out as an export.

    Its group `files` tells of each file that was sent, in order, its `name`, the `sequence_id` by
    which its rows are found, and the `problem` as JSON where there is no signature.
    """
    import h5py

    results, ids = _results(archive), {}

    def read() -> Iterator[tuple[ModalSignature, store.SequenceRecord]]:
        for number, signature in _signatures(archive, results):
            part = parts[number]
            ids[number] = signature.sequence_id
            yield signature, _record(signature, part)

    with whole_file(output) as temporary:
        write_pack(temporary, read())
        with h5py.File(temporary, "a") as file:
            group = file.create_group("files")
            columns = {
                "name": [result["name"] for result in results],
                "sequence_id": [ids.get(number, "") for number in range(len(results))],
                "problem": [
                    "" if result["error"] is None else json.dumps(result["error"])
                    for result in results
                ],
            }
            for name, texts in columns.items():
                data = np.array(texts, dtype=object)
                group.create_dataset(name, data=data, dtype=h5py.string_dtype())


def tabulate_archive(archive: Path, parts: Sequence[Part], output: Path) -> None:
    """Write a table of the signatures of an archive: a row a file, those that failed at the end."""
    results = _results(archive)
    table = cohort_table(
        Recording(
            parts[number].name,
            signature,
            subject=parts[number].subject,
            label=parts[number].label,
        )
        for number, signature in _signatures(archive, results)
    )
    failed = [(one["name"], one["error"]) for one in results if one["error"] is not None]
    write_whole(output, _with_failures(table, failed).to_csv().encode())


def _results(archive: Path) -> list[Mapping[str, Any]]:
    with zipfile.ZipFile(archive) as file:
        results: list[Mapping[str, Any]] = json.loads(file.read(RESULTS))["results"]
        return results


def _signatures(
    archive: Path, results: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[int, ModalSignature]]:
    with zipfile.ZipFile(archive) as file:
        for number, result in enumerate(results):
            if result["file"] is not None:
                yield number, store.signature_from_hdf5(file.read(result["file"]))


def _record(signature: ModalSignature, part: Part) -> store.SequenceRecord:
    return store.SequenceRecord(
        id=signature.sequence_id,
        n_frames=signature.n_frames,
        n_vertices=signature.n_vertices,
        n_faces=0,
        topology=None,
        grid=None,
        unit=signature.unit,
        has_times=signature.times is not None,
        subject=part.subject,
        label=part.label,
        created="",
        has_upload=False,
    )


def _with_failures(table: Table, failed: Sequence[tuple[str, Mapping[str, Any]]]) -> Table:
    columns = {"recording": np.array([], dtype=object), **table.columns}
    n = len(columns["recording"])
    whole: dict[str, np.ndarray[Any, Any]] = {}
    for name, column in columns.items():
        blank = "" if column.dtype.kind == "U" else np.nan
        rest = [one for one, _ in failed] if name == "recording" else [blank] * len(failed)
        whole[name] = np.array([*column.tolist(), *rest], dtype=object)
    errors = [*[""] * n, *(str(error["detail"]) for _, error in failed)]
    whole["error"] = np.array(errors, dtype=object)
    return Table(whole)
