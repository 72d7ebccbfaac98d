"""Jobs: long work, and its progress."""

from __future__ import annotations

from enum import StrEnum
from typing import Any

from pydantic import BaseModel, Field


class JobState(StrEnum):
    """State of a job; the last three are final."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


class JobAnswer(BaseModel):
    """Long work, and its progress."""

    id: str
    kind: str = Field(
        description="upload, signature, signatures, template, images, track, tracked-report, "
        "classification, training, norm, or the answer that it makes: sent-signature, "
        "sent-classification, sent-encoding, decoding, encoding, tradeoff, signature-view, "
        "distance, readouts, deviation, cohort-deviation, report, reconstruction, "
        "template-modes, template-view, model-view, track-view."
    )
    state: JobState
    progress: float = Field(description="Share that is done, 0 to 1.")
    text: str | None = Field(description="The current step, in words; null if there is none.")
    result: str | None = Field(description="Link to the result; null until there is one.")
    error: dict[str, Any] | None = Field(description="The problem it failed with.")
    created: str = Field(description="ISO 8601 in UTC.")
    updated: str = Field(description="ISO 8601 in UTC.")
    links: dict[str, str]


class JobPageAnswer(BaseModel):
    """A page of the list of jobs."""

    jobs: list[JobAnswer]
    cursor: str | None = Field(description="For the next page; null on the last.")
