"""A report of one recording: for systems, for tables and for people."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.reports.content import Quantity, Report, quantities_of, report_of
from modalmotion.reports.fhir import fhir_bundle, fhir_json
from modalmotion.reports.page import report_figure, report_pdf

__all__ = [
    "Quantity",
    "Report",
    "fhir_bundle",
    "fhir_json",
    "quantities_of",
    "report_figure",
    "report_of",
    "report_pdf",
]

check_arguments(globals())
