"""Answers for many files that were sent in one request."""

from __future__ import annotations

from pydantic import BaseModel, Field

from modalmotion_service.schemas.general import Problem
from modalmotion_service.schemas.results import UploadClassificationAnswer
from modalmotion_service.schemas.signatures import SignatureAnswer


class _Result(BaseModel):
    name: str = Field(description="As the part of the form names its file.")
    subject: str | None = Field(description="As the manifest says.")
    label: str | None
    error: Problem | None = Field(
        description="As the file would have been answered by itself; null where there is a result."
    )


class SignatureResult(_Result):
    """The signature of one of many files, or why there is none."""

    signature: SignatureAnswer | None


class SignatureResults(BaseModel):
    """Signatures of many files, in the order in which they were sent."""

    results: list[SignatureResult]
    n_failed: int


class ClassificationResult(_Result):
    """The class of one of many files, or why there is none."""

    classification: UploadClassificationAnswer | None


class ClassificationResults(BaseModel):
    """Classes of many files, in the order in which they were sent."""

    results: list[ClassificationResult]
    n_failed: int
