"""Command that writes a report of one recording."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import (
    components_option,
    example,
    list_written,
    merge_option,
    reference_option,
    signature_parameters,
    surface_options,
)
from modalmotion.cli.outputs import OutputFolder
from modalmotion.cli.waiting import Waiting
from modalmotion.signature.making import modal_signature


@click.command(epilog=example("report beat.npz --model mine.h5 --norm volunteers.h5 -o folder"))
@sequence_argument
@click.option("-o", "--out", required=True, type=OutputFolder(), help="Folder to write.")
@click.option("--modes", default=7, show_default=True, help="Modes, 3 amplitudes a frame each.")
@click.option("--model", help="Model: the name of a shipped one, or a file; none by default.")
@click.option(
    "--norm",
    "norm_file",
    type=click.Path(exists=True, path_type=Path),
    help="Norm of your own controls, a file.",
)
@click.option(
    "--issued",
    help="Time of the result, as 2026-01-31T12:00:00+00:00; now by default. The same time gives "
    "the same bytes.",
)
@surface_options
@merge_option
@reference_option
@components_option
def report(
    source: Path,
    out: Path,
    model: str | None,
    norm_file: Path | None,
    issued: str | None,
    **options: Any,
) -> None:
    """Report on the sequence in FILE: PDF for people, FHIR for systems, CSV, a page to look at.

    The folder gets report.pdf, report.fhir.json, frames.csv and view.html. A person has the last
    word: all is marked as preliminary.
    """
    from modalmotion.classification import classify
    from modalmotion.classification.answer.classification import Classification
    from modalmotion.cli.model_commands import model_named
    from modalmotion.exports.table import frame_table
    from modalmotion.norm import Deviation, norm_from_hdf5
    from modalmotion.report import fhir_json, report_of, report_pdf
    from modalmotion.store import write_atomic
    from modalmotion.viewer.page import View, view_page

    time = _time(issued)
    parameters = signature_parameters(options)
    # What was named wrongly is told before the work.
    stored_model = None if model is None else model_named(model)
    norm = None if norm_file is None else norm_from_hdf5(norm_file)
    answer: Classification | None = None
    deviation: Deviation | None = None
    with Waiting(source) as waiting:
        with waiting.watch.stage("read"):
            sequence = read(source, **options)
        signature = modal_signature(sequence, parameters, watch=waiting.watch)
        if stored_model is not None:
            with waiting.watch.stage("class"):
                answer = classify(sequence, stored_model)
        if norm is not None:
            with waiting.watch.stage("controls"):
                deviation = norm.deviation(sequence)
        with waiting.watch.stage("write"):
            found = report_of(
                signature, sequence, issued=time, classification=answer, deviation=deviation
            )
            view = View(signature, sequence, source.name, classification=answer)
            pieces = {
                "report.pdf": report_pdf(found),
                "report.fhir.json": fhir_json(found),
                "frames.csv": frame_table(signature, found.readouts, found.ventricle)
                .to_csv()
                .encode(),
                "view.html": view_page([view]).encode(),
            }
            out.mkdir(parents=True, exist_ok=True)
            for name, data in pieces.items():
                write_atomic(out / name, data)
    for note in found.caveats:
        click.echo(f"note: {note}")
    list_written(*(out / name for name in pieces))


def _time(issued: str | None) -> datetime:
    if issued is None:
        return datetime.now(UTC)
    try:
        return datetime.fromisoformat(issued)
    except ValueError:
        raise click.BadParameter(
            f"{issued!r} is no time; write it as 2026-01-31T12:00:00+00:00.",
            param_hint="--issued",
        ) from None
