"""Commands of reports: in files, as DICOM objects, and as a page to view."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click
import numpy as np

from modalmotion import store
from modalmotion.cli import files, shared, track_commands
from modalmotion.exports.reading import stream_at
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import CUP
from modalmotion.representation import with_interval

if TYPE_CHECKING:
    from modalmotion.reports import Report

report_options = shared.several(
    files.sequence_argument,
    click.option("--model", help="Model: the name of an included one, or a file; none by default."),
    click.option(
        "--norm",
        "norm_file",
        type=shared.EXISTING,
        help="Norm of your own controls, a file.",
    ),
    click.option(
        "--issued",
        help="Time of the result, as 2026-01-31T12:00:00+00:00; now by default. The same time "
        "gives the same bytes.",
    ),
    track_commands.tracking_options,
    shared.fit_options,
)
"""Source of a recording, and its options; `_reported` takes them."""


def _reported(
    source: Path,
    waiting: files.Waiting,
    model: str | None,
    norm_file: Path | None,
    issued: str | None,
    **options: Any,
) -> Report:
    """Make the report; wrong options are refused before the work."""
    from modalmotion.classification import classify, shipped_for
    from modalmotion.cli.model_commands import model_named
    from modalmotion.norm import norm_from_hdf5
    from modalmotion.reports import report_of

    try:
        time = datetime.now(UTC) if issued is None else datetime.fromisoformat(issued)
    except ValueError:
        raise click.BadParameter(
            f"{issued!r} is not a time; write it as 2026-01-31T12:00:00+00:00.",
            param_hint="--issued",
        ) from None
    if model is not None:
        model_named(model)
    norm = None if norm_file is None else norm_from_hdf5(norm_file)
    sequence, signature = track_commands.fitted_recording(source, waiting, options)
    answer = deviation = None
    if model is not None:
        with waiting.watch.stage("class"):
            # Of the included models the one for the kind of points.
            answer = classify(sequence, model_named(shipped_for(model, sequence.facts)))
    if norm is not None:
        with waiting.watch.stage("controls"):
            deviation = norm.deviation(sequence)
    found = report_of(signature, sequence, issued=time, classification=answer, deviation=deviation)
    return replace(found, name=source.name)


@shared.command("report map.nii.gz -o folder")
@report_options
def report(
    source: Path,
    out: Annotated[Path, shared.OutputFolder(".pdf", ".json", ".csv", ".html")],
    **options: Any,
) -> Any:
    """Report on the sequence in FILE: PDF, FHIR, CSV and HTML.

    FILE may also be a label map, which is tracked first; or images, points or contours, with
    --landmarks. A folder gets report.pdf, report.fhir.json, frames.csv and view.html, all marked as
    preliminary.

    Parameters
    ----------
    out
        Folder to write; or one file: .pdf, .json (FHIR), .csv or .html.
    """
    from modalmotion.reports import quantities_of
    from modalmotion.reports.page import write_report
    from modalmotion.viewer.page import View

    with files.Waiting(source) as waiting:
        found = _reported(source, waiting, **options)
        with waiting.watch.stage("write"):
            answer = found.classification
            view = View(found.signature, found.sequence, source.name, classification=answer)
            paths = write_report(found, out, view)
    numbers = {"quantities": [asdict(q) for q in quantities_of(found)], "caveats": found.caveats}
    said = (*quantity_lines(found), *(f"note: {note}" for note in found.caveats))
    return {**numbers, "written": paths}, said


def quantity_lines(found: Report) -> Iterator[str]:
    """Write the quantities of a report, each with its interval."""
    from modalmotion.reports.content import OWN, quantities_of

    for q in quantities_of(found):
        value, interval = with_interval(q.value, q.low, q.high)
        yield f"{OWN[q.name]:<32}{value:>8} {q.unit} ({interval})"


@shared.command("dicom beat.npz --study image.dcm --coordinates LPS --cavity lv -o folder")
@report_options
def dicom(
    source: Path,
    out: Annotated[Path, shared.OutputFolder()],
    study: Annotated[Path, shared.EXISTING_FILE],
    **options: Any,
) -> Any:
    """Write a DICOM structured report and surfaces of the sequence in FILE.

    The folder gets report.dcm (TID 1500) and the surfaces at the ends of diastole and systole as
    encapsulated STL, as instances of the patient's study. Coordinates must be stated as LPS, in
    mm. Needs pydicom and highdicom (extra dicom).

    Parameters
    ----------
    out
        Folder to write.
    study
        Any instance of the patient's study: its header is copied, and its pixels are not
        read.
    """
    from modalmotion.reports.dicom import dicom_instances, read_study, require_space

    with files.naming(study):
        header = read_study(study)
    with files.Waiting(source) as waiting:
        found = _reported(source, waiting, **options)
        require_space(found.sequence.facts, found.sequence.unit)
        with waiting.watch.stage("write"):
            pieces = dicom_instances(found, header)
            out.mkdir(parents=True, exist_ok=True)
            for name, data in pieces.items():
                store.write_atomic(out / name, data)
    return {"caveats": found.caveats, "written": [out / name for name in pieces]}


@shared.command("view beat.npz -o beat.html")
@files.sequence_argument
@shared.fit_options
def view(
    source: Path,
    output: Annotated[Path, shared.OutputFile(".html")],
    other: Annotated[shared.Existing, {"flag": "with"}] = None,
    classify: bool = True,
    **options: Any,
) -> Any:
    """Write an HTML page of the moving surface in FILE, with its reconstruction.

    The page is one file: it opens from disk in any browser and needs no network. For a track (.h5)
    the data are drawn over the surface. If FILE is a compressed
    stream, the page contains it and decodes it.

    Parameters
    ----------
    output
        Page to write.
    other
        A second file, shown beside the first with a common clock and camera.
    classify
        Show the class by the included model.
    """
    from modalmotion.classification import classify as ask
    from modalmotion.tracking.hdf5 import kept_track
    from modalmotion.viewer.page import View, view_page

    views = []
    with files.Waiting(source) as waiting:
        for path in filter(None, (source, other)):
            sequence, signature = files.fitted(path, waiting, {**options})
            # The included model knows ventricles only.
            answer = ask(sequence) if classify and signature.topology == CUP else None
            tracked = kept_track(path)
            data = None if tracked is None else tracked.data
            stream = _stream(path, sequence)
            views.append(
                View(signature, sequence, path.name, None, answer, data=data, stream=stream)
            )
        with waiting.watch.stage("write"):
            store.write_atomic(output, view_page(views).encode())
    return {"titles": [view.title for view in views]}


def _stream(path: Path, sequence: MeshSequence) -> bytes | None:
    """Give the bytes of a compressed file, if a page can decode them to this sequence."""
    from modalmotion.codec import decode, inspect, spatial_modes

    data = stream_at(path)
    if data is None or inspect(data).modes == spatial_modes.STORED:
        return None
    # Options of reading may have changed the order of frames.
    return data if np.array_equal(decode(data).vertices, sequence.vertices) else None
