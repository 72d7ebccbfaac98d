"""Command that writes a report of one recording."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from modalmotion.cli.options import command, json_option, tell
from modalmotion.cli.outputs import OutputFolder
from modalmotion.cli.reported import Wanted, report_options
from modalmotion.cli.waiting import Waiting

if TYPE_CHECKING:
    from modalmotion.reports.content import Quantity


@command("report map.nii.gz -o folder")
@report_options
@click.option(
    "-o",
    "--out",
    required=True,
    type=OutputFolder(".pdf", ".json", ".csv", ".html"),
    help="Folder to write; or one file: .pdf, .json (FHIR), .csv or .html.",
)
@json_option
def report(source: Path, out: Path, as_json: bool, **options: Any) -> None:
    """Report on the sequence in FILE: PDF, FHIR, CSV and HTML.

    FILE may also be a label map, which is tracked first; or images, points or contours, with
    --landmarks. A folder gets report.pdf, report.fhir.json, frames.csv and view.html, all marked as
    preliminary.
    """
    from modalmotion.reports.content import OWN, quantities_of
    from modalmotion.reports.writing import write_report
    from modalmotion.viewer.page import View

    wanted = Wanted.of(source, **options)
    with Waiting(source) as waiting:
        found = wanted.report(waiting)
        with waiting.watch.stage("write"):
            answer = found.classification
            view = View(found.signature, found.sequence, source.name, classification=answer)
            paths = write_report(found, out, view)
    quantities = quantities_of(found)
    said = [f"{OWN[q.name]:<32}{_interval(q)}" for q in quantities]
    said += [f"note: {note}" for note in found.caveats]
    numbers = {"quantities": [asdict(q) for q in quantities], "notes": found.caveats}
    tell(numbers, said, *paths, as_json=as_json)


def _interval(q: Quantity) -> str:
    return f"{q.value:8.1f} {q.unit} ({q.low:.1f} to {q.high:.1f})"
