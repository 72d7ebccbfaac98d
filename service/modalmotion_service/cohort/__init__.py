"""Signatures of many files, on this machine or on several."""

from modalmotion_service.cohort.job import CohortJob, CohortReport
from modalmotion_service.cohort.manifest import Entry, read_manifest
from modalmotion_service.cohort.run import sign_cohort

__all__ = ["CohortJob", "CohortReport", "Entry", "read_manifest", "sign_cohort"]
