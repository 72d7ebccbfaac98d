"""A report in one step: read or track, fit, classify, and write the files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from modalmotion.classification import Model, classify, load_model, shipped_for
from modalmotion.exports.reading import read
from modalmotion.exports.tables import frame_table
from modalmotion.formats.volumes.reading import holds_images
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm import Norm
from modalmotion.reports.content import Report, report_of
from modalmotion.reports.fhir import fhir_json
from modalmotion.reports.page import report_pdf
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store.disk import write_atomic
from modalmotion.tracking import Track, track
from modalmotion.viewer.page import View, view_page

_FILES: Final[dict[str, Callable[[Report, View], bytes]]] = {
    "report.pdf": lambda found, _: report_pdf(found),
    "report.fhir.json": lambda found, _: fhir_json(found),
    "frames.csv": lambda found, _: (
        frame_table(found.signature, found.readouts, found.ventricle).to_csv().encode()
    ),
    "view.html": lambda _, view: view_page([view]).encode(),
}

REPORT_SUFFIXES: Final = tuple(Path(name).suffix for name in _FILES)
"""Ends of the names of its files."""


def report(
    recording: MeshSequence | Track | Path,
    path: Path,
    *,
    model: Model | str | None = None,
    norm: Norm | None = None,
    issued: datetime | None = None,
    parameters: SignatureParameters | None = None,
) -> Report:
    """Write a report of one recording: a page for people, and files for systems.

    Parameters
    ----------
    recording : MeshSequence, Track or Path
        Images in a file are tracked first.
    path : str or Path
        A folder, for report.pdf, report.fhir.json, frames.csv and view.html; or one file
        that ends with .pdf, .json, .csv or .html.
    model : Model or str, optional
        Adds a class: a model, or the name of an included one.
    norm : Norm, optional
        Of your own controls, to compare with.
    issued : datetime, optional
        Time of the result, now by default; the same time gives the same bytes.
    parameters : SignatureParameters, optional

    Returns
    -------
    Report

    Raises
    ------
    InputError
        If the recording cannot be read, tracked or fitted.
    """
    data, name = None, ""
    if isinstance(recording, Path):
        name = recording.name
        recording = track(recording) if holds_images(recording) else read(recording)
    if isinstance(recording, Track):
        data, recording = recording.data, recording.sequence
    answer = None
    if model is not None:
        named = shipped_for(model, recording.facts) if isinstance(model, str) else model
        answer = classify(recording, load_model(named) if isinstance(named, str) else named)
    found = report_of(
        modal_signature(recording, parameters),
        recording,
        issued=datetime.now(UTC) if issued is None else issued,
        classification=answer,
        deviation=None if norm is None else norm.deviation(recording),
    )
    found = replace(found, name=name)
    view = View(found.signature, found.sequence, classification=answer, data=data)
    write_report(found, path, view)
    return found


def write_report(found: Report, path: Path, view: View) -> list[Path]:
    """Write the files of a report to a folder, or one file by its name.

    Parameters
    ----------
    found : Report
    path : Path
    view : View
        Of the page on which the surface moves.

    Returns
    -------
    list of Path
        Of the files.
    """
    paths = {name: path for name in _FILES if Path(name).suffix == path.suffix.lower()}
    if not paths:
        path.mkdir(parents=True, exist_ok=True)
        paths = {name: path / name for name in _FILES}
    for name, file in paths.items():
        write_atomic(file, _FILES[name](found, view))
    return [*paths.values()]
