"""A report as DICOM objects of the patient's study: a structured report, and surfaces."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.reports.dicom.instances import dicom_instances, dicom_zip, require_space
from modalmotion.reports.dicom.source import Study, read_study

__all__ = ["Study", "dicom_instances", "dicom_zip", "read_study", "require_space"]

check_arguments(globals())
