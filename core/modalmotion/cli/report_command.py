"""Command that writes a report of one recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from modalmotion.cli.options import example, json_option, tell
from modalmotion.cli.reported import Wanted, report_options
from modalmotion.cli.waiting import Waiting


@click.command(
    epilog=example("report study/ --landmarks heart.mrk.json --model ventricle-simulated -o folder")
)
@report_options
@json_option
def report(source: Path, out: Path, as_json: bool, **options: Any) -> None:
    """Report on the sequence in FILE: PDF for people, FHIR for systems, CSV, a page to look at.

    FILE may be images, points or contours too, which are tracked first: with --landmarks.
    The folder gets report.pdf, report.fhir.json, frames.csv and view.html. A person has the last
    word: all is marked as preliminary.
    """
    from modalmotion.exports.table import frame_table
    from modalmotion.report import fhir_json, report_pdf
    from modalmotion.store import write_atomic
    from modalmotion.viewer.page import View, view_page

    wanted = Wanted.of(source, **options)
    with Waiting(source) as waiting:
        found = wanted.report(waiting)
        signature = found.signature
        with waiting.watch.stage("write"):
            view = View(signature, found.sequence, source.name, classification=found.classification)
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
    said = [f"note: {note}" for note in found.caveats]
    tell({"notes": found.caveats}, said, *(out / name for name in pieces), as_json=as_json)
