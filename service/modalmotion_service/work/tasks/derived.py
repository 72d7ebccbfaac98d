"""What follows from a signature: volumes, surfaces, the trade, reports, pages."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np

from modalmotion import store
from modalmotion.classification.answer_hdf5 import classification_from_hdf5
from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.ventricle import ventricle_readouts
from modalmotion.errors import LimitError, ParameterError
from modalmotion.exports.signature_pack import SurfaceFormat, write_superposed
from modalmotion.exports.tables import frame_table
from modalmotion.formats import ReadLimits
from modalmotion.mesh.facts import Facts
from modalmotion.pictures.readouts import volume_figure
from modalmotion.progress import Stopwatch
from modalmotion.reports import Report, fhir_json, report_of, report_pdf
from modalmotion.reports.dicom import dicom_zip, read_study
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.tradeoff import as_plain, measure_tradeoff
from modalmotion.template.body_frame import Components
from modalmotion.viewer.page import View, view_page
from modalmotion.viewer.payload import frames_payload
from modalmotion_service.http.negotiation import CSV, PDF, PNG
from modalmotion_service.schemas.results import ReadoutsAnswer
from modalmotion_service.schemas.signatures import TradeoffAnswer
from modalmotion_service.work.tasks.files import (
    Fitted,
    ProgressFile,
    png_of,
    whole_file,
    write_whole,
)
from modalmotion_service.work.upload import parser_for

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
    result = clinical_readouts(fitted, loaded, template=named)
    if how == PNG:
        return png_of(volume_figure(result))
    ventricle = ventricle_readouts(fitted, loaded, result, template=named)
    if how == CSV:
        return frame_table(fitted, result, ventricle).to_csv().encode()
    answer = ReadoutsAnswer.of(result, ventricle)
    if how == STRAIN:
        if answer.strain is None:
            raise ParameterError(
                " ".join(ventricle.reasons) or "The surface is no wall with a strain.",
                remedy="Ask for the strain of a surface with coordinates along and around it.",
            )
        return answer.strain.model_dump_json().encode()
    return answer.model_dump_json().encode()


# Parts of the whole.
_SHARES: Final = {"template": 0.1, "front": 0.5, "scene": 0.05, "choice": 0.2, "timing": 0.1}


def measure_trade(
    sequence: Path,
    parameters: SignatureParameters,
    front_modes: int,
    components: Components | None,
    template: Path | None,
    media_type: str,
    output: Path,
    facts: Facts,
    progress: Path,
) -> tuple[dict[str, float]]:
    """Measure the trade on a kept sequence, as JSON or PNG; gives milliseconds by stage.

    `progress` is a `ProgressFile`.
    """
    found = measure_tradeoff(
        store.sequence_from_hdf5(sequence).with_facts(facts),
        parameters,
        most_modes=front_modes,
        components=None if components is None else (components,),
        template=None if template is None else store.template_from_hdf5(template),
        watch=Stopwatch(_SHARES, ProgressFile(progress).write),
    )
    with whole_file(output) as temporary:
        if media_type == PNG:
            from modalmotion.pictures.tradeoff import tradeoff_figure

            tradeoff_figure(found).savefig(temporary, format="png")
        else:
            temporary.write_text(TradeoffAnswer(**as_plain(found)).model_dump_json())
    return (dict(found.milliseconds),)


def superpose(
    one: Fitted,
    surface_format: SurfaceFormat,
    times: list[float] | None,
    phases: list[float] | int | None,
    max_targets: int | None,
    output: Path,
) -> None:
    """Write the surfaces that a signature represents."""
    write_whole(
        output,
        write_superposed(
            store.signature_from_hdf5(one.signature),
            store.sequence_from_hdf5(one.sequence),
            surface_format,
            template=one.read_template(),
            times=None if times is None else np.array(times),
            phases=phases,
            max_targets=max_targets,
        ),
    )


def make_report(one: Fitted, media_type: str, classification: Path | None) -> bytes:
    """Report on a signature, as FHIR, PDF or a table; the same bytes every time."""
    report = _report(one, classification)
    if media_type == PDF:
        return report_pdf(replace(report, name=one.title))
    if media_type == CSV:
        table = frame_table(report.signature, report.readouts, report.ventricle)
        return table.to_csv().encode()
    return fhir_json(report)


def make_dicom(
    one: Fitted, instance: Path, limits: ReadLimits, classification: Path | None, output: Path
) -> None:
    """Write a report on a signature as a zip of objects of an instance's study."""
    study = read_study(instance, parser=parser_for(limits))
    write_whole(output, dicom_zip(_report(one, classification), study))


def _report(one: Fitted, classification: Path | None) -> Report:
    return report_of(
        store.signature_from_hdf5(one.signature),
        one.read_sequence(),
        issued=datetime.fromisoformat(one.record.created),
        template=one.read_template(),
        classification=None if classification is None else classification_from_hdf5(classification),
    )


# Of one answer: a page asks for the frames of a large surface a piece at a time.
MOST_FRAME_BYTES: Final = 64_000_000


def make_view(one: Fitted, as_page: bool, output: Path) -> None:
    """Write what a page needs first of a kept signature; or the whole page, as one file.

    A page of one file is shown without a service: it holds the data of a track itself.
    """
    view = View(
        store.signature_from_hdf5(one.signature),
        one.read_sequence(),
        template=one.read_template(),
        title=one.title,
    )
    track = one.track
    if not as_page:
        write_whole(output, replace(view, is_tracked=track is not None).payload())
        return
    data = None if track is None else store.track_from_hdf5(track).data
    write_whole(output, view_page([replace(view, data=data)]).encode())


def make_frames(one: Fitted, first: int, stop: int | None, output: Path) -> None:
    """Write frames as they were sent.

    Raises
    ------
    LimitError
        If they are more than one answer has.
    """
    loaded, fitted = (
        store.sequence_from_hdf5(one.sequence),
        store.signature_from_hdf5(one.signature),
    )
    frames = range(loaded.n_frames)[first:stop]
    size = 6 * loaded.n_vertices * len(frames)
    if size > MOST_FRAME_BYTES and len(frames) > 1:
        raise LimitError(
            f"{len(frames)} frames take {size} bytes; an answer has at most {MOST_FRAME_BYTES}.",
            remedy="Ask for fewer frames at a time: first and stop name them.",
            limit="view_frame_bytes",
            details={"value": size, "most": MOST_FRAME_BYTES},
        )
    named = one.read_template()
    write_whole(output, frames_payload(loaded, fitted, first, stop, template=named))
