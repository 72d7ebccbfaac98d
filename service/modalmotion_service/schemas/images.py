"""Images: what is said of them, which is never what their headers say of a person."""

from __future__ import annotations

from dataclasses import asdict
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from modalmotion.store import ImagesRecord
from modalmotion_service.schemas.fields import SequenceId


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


class ImagesPageAnswer(BaseModel):
    """A page of the list of images."""

    images: list[ImagesSummary]
    cursor: str | None = Field(description="For the next page; null on the last.")


class SlicesQuery(BaseModel):
    """What is sent beside the slices of a frame."""

    model_config = ConfigDict(extra="forbid")

    track: SequenceId | None = Field(
        None, description="Made of these images: its surface is sent too, and each slice's shift."
    )


class ImagesListQuery(BaseModel):
    """Which images to list."""

    model_config = ConfigDict(extra="forbid")

    limit: int = Field(100, ge=1, le=1000, description="Of one page.")
    cursor: str | None = Field(None, max_length=200, description="Of the page before.")
