"""Reports on kept signatures."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from modalmotion.classification.answer.hdf5 import classification_from_hdf5
from modalmotion.exports.table import frame_table
from modalmotion.facts import Facts
from modalmotion.report import fhir_json, report_of, report_pdf
from modalmotion.store import sequence_from_hdf5, signature_from_hdf5, template_from_hdf5
from modalmotion_service.http.negotiation import CSV, PDF


def make_report(
    sequence: Path,
    signature: Path,
    template: Path | None,
    media_type: str,
    facts: Facts,
    classification: Path | None,
    issued: str,
) -> bytes:
    """Report on a kept signature, as FHIR, PDF or a table; the same bytes every time."""
    fitted = signature_from_hdf5(signature)
    report = report_of(
        fitted,
        sequence_from_hdf5(sequence).with_facts(facts),
        issued=datetime.fromisoformat(issued),
        template=None if template is None else template_from_hdf5(template),
        classification=None if classification is None else classification_from_hdf5(classification),
    )
    if media_type == PDF:
        return report_pdf(report)
    if media_type == CSV:
        return frame_table(fitted, report.readouts, report.ventricle).to_csv().encode()
    return fhir_json(report)
