"""Reports on kept signatures."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path

from modalmotion.classification.answer_hdf5 import classification_from_hdf5
from modalmotion.exports.table import frame_table
from modalmotion.facts import Facts
from modalmotion.formats import ReadLimits
from modalmotion.reports import Report, fhir_json, report_of, report_pdf
from modalmotion.reports.dicom import dicom_zip, read_study
from modalmotion.store import signature_from_hdf5, template_from_hdf5
from modalmotion_service.http.negotiation import CSV, PDF
from modalmotion_service.work.parsing import parser_for
from modalmotion_service.work.tasks.files import loaded_sequence, write_whole


def make_report(
    sequence: Path,
    signature: Path,
    template: Path | None,
    media_type: str,
    facts: Facts,
    classification: Path | None,
    issued: str,
    track: Path | None,
    name: str,
) -> bytes:
    """Report on a kept signature, as FHIR, PDF or a table; the same bytes every time."""
    report = _report(sequence, signature, template, facts, classification, issued, track)
    if media_type == PDF:
        return report_pdf(replace(report, name=name))
    if media_type == CSV:
        table = frame_table(report.signature, report.readouts, report.ventricle)
        return table.to_csv().encode()
    return fhir_json(report)


def make_dicom(
    sequence: Path,
    signature: Path,
    template: Path | None,
    instance: Path,
    limits: ReadLimits,
    facts: Facts,
    classification: Path | None,
    issued: str,
    track: Path | None,
    output: Path,
) -> None:
    """Write a report on a kept signature as a zip of objects of an instance's study."""
    study = read_study(instance, parser=parser_for(limits))
    report = _report(sequence, signature, template, facts, classification, issued, track)
    write_whole(output, dicom_zip(report, study))


def _report(
    sequence: Path,
    signature: Path,
    template: Path | None,
    facts: Facts,
    classification: Path | None,
    issued: str,
    track: Path | None,
) -> Report:
    return report_of(
        signature_from_hdf5(signature),
        loaded_sequence(sequence, track).with_facts(facts),
        issued=datetime.fromisoformat(issued),
        template=None if template is None else template_from_hdf5(template),
        classification=None if classification is None else classification_from_hdf5(classification),
    )
