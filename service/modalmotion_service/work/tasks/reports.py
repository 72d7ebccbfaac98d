"""Reports on kept signatures."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path

from modalmotion.classification.answer_hdf5 import classification_from_hdf5
from modalmotion.exports.tables import frame_table
from modalmotion.formats import ReadLimits
from modalmotion.reports import Report, fhir_json, report_of, report_pdf
from modalmotion.reports.dicom import dicom_zip, read_study
from modalmotion.store import signature_from_hdf5
from modalmotion_service.http.negotiation import CSV, PDF
from modalmotion_service.work.fitted import Fitted
from modalmotion_service.work.parsing import parser_for
from modalmotion_service.work.tasks.files import write_whole


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
        signature_from_hdf5(one.signature),
        one.read_sequence(),
        issued=datetime.fromisoformat(one.record.created),
        template=one.read_template(),
        classification=None if classification is None else classification_from_hdf5(classification),
    )
