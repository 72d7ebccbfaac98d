"""Signatures made, written out, compared and packed; and what follows from one."""

import contextlib
import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion import clinical, errors, reports, store
from modalmotion.classification.answer import classification_from_hdf5
from modalmotion.clinical.ventricle import ventricle_readouts
from modalmotion.exports import signature_pack, tables
from modalmotion.formats import ReadLimits
from modalmotion.formats.frame_files import stored_zip
from modalmotion.mesh.checks import single_precision
from modalmotion.mesh.facts import Facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.pictures.readouts import volume_figure
from modalmotion.progress import Stopwatch
from modalmotion.reports import dicom
from modalmotion.reports.page import FILES
from modalmotion.signature import distance, making, tradeoff
from modalmotion.template.body_frame import Components
from modalmotion.viewer import page, payload
from modalmotion_service.http.negotiation import CSV, FHIR, HDF5, JSON, NPZ, PDF, PNG, RAW
from modalmotion_service.schemas.results import ReadoutsAnswer
from modalmotion_service.schemas.signatures import SignatureAnswer, TradeoffAnswer
from modalmotion_service.work.tasks.files import (
    Fitted,
    ProgressFile,
    loaded_sequence,
    named_template,
    png_of,
    whole_file,
    write_whole,
)
from modalmotion_service.work.upload import Upload, parser_for

# Parts of the whole, of a large mesh; the rest is for the server.
_SHARES: Final = {"load": 0.05, "template": 0.5, "fit": 0.3, "notes": 0.05, "image": 0.05}


def sign(
    sequence: Path,
    parameters: making.SignatureParameters,
    template: Path | None,
    track: Path | None,
    image: Path,
    progress: Path,
) -> None:
    """Fit a kept sequence and write its signature's HDF5 image.

    `track` is that of the sequence, where it has one: it says how far positions may be off.
    `progress` is a `ProgressFile`.
    """
    watch = Stopwatch(_SHARES, ProgressFile(progress).write)
    with watch.stage("load"):
        loaded = loaded_sequence(sequence, track)
        named = named_template(template)
    signature = making.modal_signature(loaded, parameters, template=named, watch=watch)
    with watch.stage("image"):
        write_whole(image, store.signature_image(signature))


def sign_upload(
    upload: Upload, parameters: making.SignatureParameters, template: Path | None, media_type: str
) -> bytes:
    """Fit an upload and write its signature out."""
    sequence = upload.read().sequence
    signature = making.modal_signature(sequence, parameters, template=named_template(template))
    if media_type == PNG:
        return _as_png(signature, sequence)
    return _SIGNATURE_WRITERS[media_type](signature)


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


def compare_signatures(a: Fitted, b: Fitted, closed: bool) -> distance.Comparison:
    """Compare two signatures."""
    return distance.compare(
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
        signature_pack.write_pack(temporary, zip(loaded, records, strict=True))


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
            with contextlib.suppress(errors.InputError):
                stated = store.sequence_from_hdf5(sequence).with_facts(record.facts)
                readouts = clinical.clinical_readouts(signature, stated, template=used)
        rows.append(tables.Recording(record.id, signature, readouts, record.subject, record.label))
    write_whole(output, tables.cohort_table(rows).to_csv().encode())


def _as_npz(signature: making.ModalSignature) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **_trajectory(signature))
    return buffer.getvalue()


def _as_png(signature: making.ModalSignature, sequence: MeshSequence) -> bytes:
    from modalmotion.pictures.signature import signature_figure

    return png_of(signature_figure(sequence, signature))


_SIGNATURE_WRITERS: Final[dict[str, Callable[[making.ModalSignature], bytes]]] = {
    JSON: lambda one: SignatureAnswer.of(one).model_dump_json().encode(),
    HDF5: store.signature_to_hdf5,
    NPZ: _as_npz,
    CSV: lambda one: tables.amplitude_table(one).to_csv().encode(),
    RAW: lambda one: single_precision(one.amplitudes, "An amplitude").tobytes(),
}


def _trajectory(signature: making.ModalSignature) -> dict[str, Any]:
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


STRAIN: Final = "strain"
"""In place of a media type: the strain alone, as JSON."""


def read_out(one: Fitted, how: str) -> bytes:
    """Read volumes and strain from a kept signature, as JSON, PNG or a table; or `STRAIN` alone.

    Raises
    ------
    ParameterError
        If the strain is asked for, and the surface has none.
    """
    fitted, loaded, named = one.read_signature(), one.read_sequence(), one.read_template()
    result = clinical.clinical_readouts(fitted, loaded, template=named)
    if how == PNG:
        return png_of(volume_figure(result))
    ventricle = ventricle_readouts(fitted, loaded, result, template=named)
    if how == CSV:
        return tables.frame_table(fitted, result, ventricle).to_csv().encode()
    answer = ReadoutsAnswer.of(result, ventricle)
    if how == STRAIN:
        if answer.strain is None:
            raise errors.ParameterError(
                " ".join(map(str, ventricle.reasons)) or "The surface is no wall with a strain.",
                remedy="Ask for the strain of a surface with coordinates along and around it.",
            )
        return answer.strain.model_dump_json().encode()
    return answer.model_dump_json().encode()


# Parts of the whole.
_TRADE_SHARES: Final = {"template": 0.1, "front": 0.5, "scene": 0.05, "choice": 0.2, "timing": 0.1}


def measure_trade(
    sequence: Path,
    parameters: making.SignatureParameters,
    front_modes: int,
    components: Components | None,
    template: Path | None,
    media_type: str,
    output: Path,
    facts: Facts,
    progress: Path,
) -> None:
    """Measure the trade on a kept sequence, as JSON or PNG.

    `progress` is a `ProgressFile`.
    """
    found = tradeoff.measure_tradeoff(
        store.sequence_from_hdf5(sequence).with_facts(facts),
        parameters,
        most_modes=front_modes,
        components=None if components is None else (components,),
        template=named_template(template),
        watch=Stopwatch(_TRADE_SHARES, ProgressFile(progress).write),
    )
    with whole_file(output) as temporary:
        if media_type == PNG:
            from modalmotion.pictures.signature import tradeoff_figure

            tradeoff_figure(found).savefig(temporary, format="png")
        else:
            temporary.write_text(TradeoffAnswer(**tradeoff.as_plain(found)).model_dump_json())


def superpose(
    one: Fitted,
    surface_format: signature_pack.SurfaceFormat,
    times: list[float] | None,
    phases: list[float] | int | None,
    max_targets: int | None,
    output: Path,
) -> None:
    """Write the surfaces that a signature represents."""
    write_whole(
        output,
        signature_pack.write_superposed(
            store.signature_from_hdf5(one.signature),
            store.sequence_from_hdf5(one.sequence),
            surface_format,
            template=one.read_template(),
            times=None if times is None else np.array(times),
            phases=phases,
            max_targets=max_targets,
        ),
    )


_NAMES: Final = {FHIR: "report.fhir.json", PDF: "report.pdf", CSV: "frames.csv"}


def make_report(one: Fitted, media_type: str, classification: Path | None) -> bytes:
    """Report on a signature, as FHIR, PDF or a table; the same bytes every time."""
    report = replace(_report(one, classification), name=one.title)
    return FILES[_NAMES[media_type]](report, page.View(report.signature, report.sequence))


def make_dicom(
    one: Fitted, instance: Path, limits: ReadLimits, classification: Path | None, output: Path
) -> None:
    """Write a report on a signature as a zip of objects of an instance's study."""
    study = dicom.read_study(instance, parser=parser_for(limits))
    write_whole(output, dicom.dicom_zip(_report(one, classification), study))


def _report(one: Fitted, classification: Path | None) -> reports.Report:
    return reports.report_of(
        store.signature_from_hdf5(one.signature),
        one.read_sequence(),
        issued=datetime.fromisoformat(one.record.created),
        template=one.read_template(),
        classification=None if classification is None else classification_from_hdf5(classification),
    )


# Of one answer: a page asks for the frames of a large surface a piece at a time.
MOST_FRAME_BYTES: Final = 64_000_000


def make_whole_report(one: Fitted, classification: Path | None, output: Path) -> None:
    """Write each form of a report on a signature, and its page, to a zip."""
    report = replace(_report(one, classification), name=one.title)
    view = _view_of(one, as_page=True)
    files = {name: write(report, view) for name, write in FILES.items()}
    write_whole(output, stored_zip(files, zipfile.ZIP_DEFLATED))


def make_view(one: Fitted, as_page: bool, output: Path) -> None:
    """Write what a page needs first of a kept signature; or the whole page, as one file.

    A page of one file is shown without a service: it holds the data of a track itself.
    """
    view = _view_of(one, as_page=as_page)
    write_whole(output, page.view_page([view]).encode() if as_page else view.payload())


def _view_of(one: Fitted, *, as_page: bool) -> page.View:
    track = one.track
    return page.View(
        store.signature_from_hdf5(one.signature),
        one.read_sequence(),
        template=one.read_template(),
        title=one.title,
        is_tracked=track is not None and not as_page,
        data=store.track_from_hdf5(track).data if as_page and track is not None else None,
    )


def make_frames(one: Fitted, first: int, stop: int | None, output: Path) -> None:
    """Write frames as they were sent.

    Raises
    ------
    LimitError
        If they are more than one answer has.
    """
    loaded = store.sequence_from_hdf5(one.sequence)
    fitted = store.signature_from_hdf5(one.signature)
    frames = range(loaded.n_frames)[first:stop]
    size = 6 * loaded.n_vertices * len(frames)
    if size > MOST_FRAME_BYTES and len(frames) > 1:
        raise errors.LimitError(
            f"{len(frames)} frames take {size} bytes; an answer has at most {MOST_FRAME_BYTES}.",
            remedy="Ask for fewer frames at a time: first and stop name them.",
            limit="view_frame_bytes",
            details={"value": size, "most": MOST_FRAME_BYTES},
        )
    named = one.read_template()
    write_whole(output, payload.frames_payload(loaded, fitted, first, stop, template=named))
