"""Command that writes DICOM objects of one recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from modalmotion.cli.options import command, json_option, tell
from modalmotion.cli.outputs import OutputFolder
from modalmotion.cli.reported import Wanted, report_options
from modalmotion.cli.waiting import Waiting


@command("dicom beat.npz --study image.dcm --coordinates LPS --cavity lv -o folder")
@report_options
@click.option("-o", "--out", required=True, type=OutputFolder(), help="Folder to write.")
@click.option(
    "--study",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Any instance of the patient's study: its header is copied, and its pixels are not read.",
)
@json_option
def dicom(source: Path, out: Path, study: Path, as_json: bool, **options: Any) -> None:
    """Write a DICOM structured report and surfaces of the sequence in FILE.

    The folder gets report.dcm (TID 1500) and the surfaces at the ends of diastole and systole as
    encapsulated STL, as instances of the patient's study. Coordinates must be stated as LPS, in
    mm. Needs pydicom and highdicom (extra dicom).
    """
    from modalmotion.reports.dicom import dicom_instances, read_study, require_space
    from modalmotion.store import write_atomic

    wanted = Wanted.of(source, **options)
    header = read_study(study)
    with Waiting(source) as waiting:
        found = wanted.report(waiting)
        require_space(found.sequence.facts, found.sequence.unit)
        with waiting.watch.stage("write"):
            pieces = dicom_instances(found, header)
            out.mkdir(parents=True, exist_ok=True)
            for name, data in pieces.items():
                write_atomic(out / name, data)
    said = [f"note: {note}" for note in found.caveats]
    tell({"notes": found.caveats}, said, *(out / name for name in pieces), as_json=as_json)
