"""Stored sequences, images and what files said."""

from __future__ import annotations

from dataclasses import asdict
from typing import Final, Literal

from pydantic import BaseModel, Field

from modalmotion.formats import Reading
from modalmotion.mesh import Facts, facts_as_json
from modalmotion.mesh.facts import (
    Cavity,
    CoordinateSystem,
    Handedness,
    Tracking,
)
from modalmotion.store import ImagesRecord, SequenceRecord
from modalmotion_service.schemas.fields import Paged
from modalmotion_service.schemas.from_core import descriptions

_WORDS: Final = descriptions(Facts)


class FactsAnswer(BaseModel):
    """Facts of a sequence beside its arrays; not part of its id."""

    tracking: Tracking = Field(description=_WORDS["tracking"])
    handedness: Handedness
    coordinates: CoordinateSystem = Field(description=_WORDS["coordinates"])
    period: float | None = Field(description=_WORDS["period"])
    cavity: Cavity = Field(description=_WORDS["cavity"])
    modality: str | None = Field(description=_WORDS["modality"])
    landmarks: dict[str, int | list[int | float | list[float]]] = Field(
        description=_WORDS["landmarks"]
    )
    covariates: dict[str, int | float | str] = Field(description=_WORDS["covariates"])

    @staticmethod
    def of(facts: Facts) -> FactsAnswer:
        """Write facts out."""
        return FactsAnswer.model_validate(facts_as_json(facts))


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
                "signatures": f"{here}/signatures",
                "classifications": f"/v1/signatures/{record.id}/classifications",
            },
        )


class SequencePageAnswer(Paged):
    """A page of the list of sequences."""

    sequences: list[SequenceSummary]


class ImagesSummary(BaseModel):
    """Images over time, in LPS mm."""

    id: str = Field(description="sha256 of samples, places and times, in hex.")
    kind: Literal["volumes", "planes"]
    n_frames: int
    missing: list[int] = Field(description="Frames without an image.")
    shapes: list[list[int]] = Field(
        description="Samples along each axis: of the volume, or of each plane of a frame."
    )
    spacings: list[list[float]] = Field(description="Between samples along each axis, mm.")
    thicknesses: list[float] = Field(description="Of planes, mm; none of volumes.")
    times: list[float] | None = Field(description="In s; null where no file states them.")
    period: float | None = Field(description="Of the cycle, in s, where the files state it.")
    n_bytes: int = Field(description="Of the samples.")
    notes: list[str]
    created: str = Field(description="When they were first received, UTC, ISO 8601.")
    is_kept: bool = Field(description="Whether they stay after they were tracked.")
    tracks: list[str] = Field(description="Ids of the tracks that they are kept for.")
    is_label_map: bool = Field(description="Whether they are a segmentation.")
    apex: list[list[float] | None] = Field(
        description="Of a segmentation: proposed in each frame, LPS mm; empty where it is not."
    )
    base: list[list[float] | None]
    links: dict[str, str]

    @staticmethod
    def of(record: ImagesRecord) -> ImagesSummary:
        """Summarise a record."""
        here = f"/v1/images/{record.id}"
        links = {"self": here, "track": f"/v1/tracks?images={record.id}"}
        return ImagesSummary(**asdict(record), links=links)


class ImagesPageAnswer(Paged):
    """A page of the list of images."""

    images: list[ImagesSummary]
