"""Health, problems, jobs, the audit log, facts: answers of every part of the service."""

from enum import StrEnum
from typing import Any, Literal

from pydantic import ConfigDict

from modalmotion.formats import Reading
from modalmotion.mesh.fact_forms import facts_as_json
from modalmotion.mesh.facts import Facts
from modalmotion.notes import Note
from modalmotion_service.access.audit import AuditEntry, Event
from modalmotion_service.schemas.from_core import Answer, Paged, mirrors, read_from


class Health(Answer):
    """State of the service."""

    status: Literal["ok"] = "ok"
    version: str


class Readiness(Health):
    """State of the service and of its workers."""

    stateless: bool
    """Whether nothing is kept here; rates are then counted by each such service for itself."""
    parsers_confined: bool | None
    """Whether what parses HDF5, MATLAB and images sees nothing but its file; null where only the
    workers of a scheduler know."""


class Problem(Answer):
    """An error, after RFC 9457."""

    model_config = ConfigDict(extra="allow")

    type: str
    title: str
    status: int
    code: str
    """Stable name of the kind of problem."""
    detail: str
    frame: int | None = None
    """Frame at fault, counted from 0."""
    vertex: int | None = None
    """Vertex at fault, counted from 0."""
    limit: str | None = None
    """Limit that was exceeded."""
    remedy: str | None = None
    """What to do about it."""


class JobState(StrEnum):
    """State of a job; the last three are final."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


class JobAnswer(Answer):
    """Long work, and its progress."""

    id: str
    kind: str
    """Name of the operation that it does."""
    state: JobState
    progress: float
    """Share that is done, 0 to 1."""
    text: str | None
    """The current step, in words; null if there is none."""
    result: str | None
    """Link to the result; null until there is one."""
    error: dict[str, Any] | None
    """The problem it failed with."""
    created: str
    """ISO 8601 in UTC."""
    updated: str
    """ISO 8601 in UTC."""
    links: dict[str, str]


class JobPageAnswer(Paged):
    """A page of the list of jobs."""

    jobs: list[JobAnswer]


@mirrors(AuditEntry, Event)
class AuditEntryAnswer(Answer):
    """Who requested what; the method is COMMAND for one of the command line."""

    number: int
    ids: list[str]

    @staticmethod
    def of(entry: AuditEntry) -> "AuditEntryAnswer":
        """Write an entry out."""
        return read_from(AuditEntryAnswer, entry, ids=entry.ids.split())


class AuditPageAnswer(Paged):
    """A page of the audit log."""

    entries: list[AuditEntryAnswer]


@mirrors(Facts)
class FactsAnswer(Answer):
    """Facts of a sequence beside its arrays; not part of its id."""

    landmarks: dict[str, int | list[int | float | list[float]]]
    covariates: dict[str, int | float | str]

    @staticmethod
    def of(facts: Facts) -> "FactsAnswer":
        """Write facts out."""
        return FactsAnswer.model_validate(facts_as_json(facts))


@mirrors(Reading, without=["sequence"])
class ReadingAnswer(Answer):
    """How a file was read: everything besides the sequence in it."""

    notes: list[Note]

    @staticmethod
    def of(reading: Reading) -> "ReadingAnswer":
        """Write a reading out, without the sequence."""
        return read_from(ReadingAnswer, reading)
