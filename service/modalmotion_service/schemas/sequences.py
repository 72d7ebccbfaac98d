"""Sequences, and how a file is read."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from modalmotion.facts import NO_FACTS, Facts
from modalmotion.formats import Format, Reading, ReadLimits, ReadOptions
from modalmotion.store import SequenceRecord
from modalmotion_service.schemas.facts import FactsAnswer, FactsPatch, FactsQuery
from modalmotion_service.schemas.fields import GRID, TOPOLOGY, JsonBody, parse_grid, parse_times


class ReadingAnswer(BaseModel):
    """How a file was read: everything besides the sequence in it."""

    format: str
    ignored: list[str] = Field(description="Arrays and members that were not used.")
    coordinate_system: str | None = Field(
        description="Directions of the axes as the file names them; positions are never turned."
    )
    unit_from: str | None = Field(description="Who states the unit: file, format or caller.")
    times_from: str | None = Field(description="Who states the times: file, format or caller.")
    notes: list[str]

    @staticmethod
    def of(reading: Reading) -> ReadingAnswer:
        """Write a reading out, without the sequence."""
        return ReadingAnswer(
            format=reading.format,
            ignored=list(reading.ignored),
            coordinate_system=reading.coordinate_system,
            unit_from=reading.unit_from,
            times_from=reading.times_from,
            notes=list(reading.notes),
        )


class ReadingQuery(FactsQuery):
    """Statements about a file, which override its own."""

    model_config = ConfigDict(extra="forbid")

    format: Format | None = Field(None, description="Recognised by its content by default.")
    topology: str | None = TOPOLOGY
    grid: str | None = GRID
    unit: str | None = Field(None, max_length=20, description="m, cm, mm, um or nm.")
    times: str | None = Field(
        # A request line holds 64 KiB; more of them stand in the file.
        None,
        max_length=50_000,
        description="In s, such as 0,0.04,0.08.",
    )
    frame_interval: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="In s, in place of times."
    )
    n_vertices: int | None = Field(None, ge=1, description="Of raw numbers: vertices a frame.")
    dtype: Literal["float32", "float64"] = Field("float32", description="Of raw numbers.")
    animation: str | None = Field(None, max_length=200, description="Of GLB: by its name.")

    @cached_property
    def _options(self) -> ReadOptions:
        return ReadOptions(
            format=self.format,
            unit=self.unit,
            times=None if self.times is None else tuple(parse_times(self.times)),
            frame_interval=self.frame_interval,
            topology=self.topology,
            grid=parse_grid(self.grid),
            n_vertices=self.n_vertices,
            dtype=self.dtype,
            animation=self.animation,
            facts=self.facts(),
        )

    def options(self, limits: ReadLimits, facts: Facts = NO_FACTS) -> ReadOptions:
        """Translate to the reader's options; facts of the query override `facts`.

        Once but for limits and facts: requests share what they repeat.
        """
        options = self._options
        return replace(options, limits=limits, facts=options.facts.over(facts))


class UploadQuery(ReadingQuery):
    """Statements about an upload."""

    subject: str | None = Field(None, max_length=200, description="Whose surface it is.")
    label: str | None = Field(None, max_length=200, description="Known motion class.")


class SequenceSummary(BaseModel):
    """Summary of a stored sequence."""

    id: str = Field(description="sha256 of the content, in hex.")
    n_frames: int
    n_vertices: int
    n_faces: int
    topology: str | None = Field(description="As stated with the upload; null if it was not.")
    grid: list[int] | None = Field(description="Nodes along each axis of a lattice.")
    unit: str | None = Field(description="Length unit; null if unknown.")
    has_times: bool
    name: str | None = Field(description="What its owner calls it, such as the name of a file.")
    subject: str | None
    label: str | None
    created: str = Field(description="When it was first received, ISO 8601 in UTC.")
    facts: FactsAnswer
    reading: ReadingAnswer | None = Field(
        None, description="How the upload was read; only in the answer to it."
    )
    links: dict[str, str]

    @staticmethod
    def of(record: SequenceRecord, reading: ReadingAnswer | None = None) -> SequenceSummary:
        """Summarise a record of the store."""
        here = f"/v1/sequences/{record.id}"
        return SequenceSummary(
            id=record.id,
            n_frames=record.n_frames,
            n_vertices=record.n_vertices,
            n_faces=record.n_faces,
            topology=record.topology,
            grid=None if record.grid is None else list(record.grid),
            unit=record.unit,
            has_times=record.has_times,
            name=record.name,
            subject=record.subject,
            label=record.label,
            created=record.created,
            facts=FactsAnswer.of(record.facts),
            reading=reading,
            links={
                "self": here,
                "signature": f"{here}/signature",
                "classifications": f"{here}/classifications",
            },
        )


class SequencePageAnswer(BaseModel):
    """A page of the list of sequences."""

    sequences: list[SequenceSummary]
    cursor: str | None = Field(description="For the next page; null on the last.")


class SequenceNames(JsonBody):
    """What is stated of a sequence: a missing field stays, null removes it."""

    name: str | None = Field(
        None, max_length=200, description="What to call it, such as the name of a file."
    )
    subject: str | None = Field(None, max_length=200, description="Whose surface it is.")
    label: str | None = Field(None, max_length=200, description="Known motion class.")
    facts: FactsPatch | None = Field(None, description="Null makes all of them unknown.")
    unit: str | None = Field(None, max_length=20, description="m, cm, mm, um or nm.")
    times: list[float] | None = Field(
        None, max_length=100_000, description="Of the frames, in s, rising."
    )

    @property
    def restates(self) -> bool:
        """Whether it makes another sequence: unit and times are part of its id."""
        return bool(self.model_fields_set & {"unit", "times"})
