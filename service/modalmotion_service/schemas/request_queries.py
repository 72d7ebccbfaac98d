"""Queries of requests whose answers nobody keeps, which a job may have to remember."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from modalmotion_service.schemas.fields import SequenceId
from modalmotion_service.schemas.results import EncodingTarget, ModelQuery
from modalmotion_service.schemas.sequences import ReadingQuery
from modalmotion_service.schemas.signatures import SignatureQuery


class TemplateQuery(ReadingQuery, SignatureQuery):
    """How to read the file, and how to lay natural coordinates over the surface in it."""


class ClassifyQuery(ReadingQuery, ModelQuery):
    """How to read the file, the model, and how sure its class set must be."""


class EncodeQuery(ReadingQuery, EncodingTarget):
    """How to read the file, and at what error to encode the sequence in it."""


class DecodeQuery(BaseModel):
    """Which frames and vertices of a stream to decode."""

    model_config = ConfigDict(extra="forbid")

    first: int | None = Field(None, ge=0, description="First frame; the stream's own by default.")
    stop: int | None = Field(None, ge=1, description="Frame after the last.")
    first_vertex: int | None = Field(
        None, ge=0, description="First vertex; of some vertices come the triangles between them."
    )
    stop_vertex: int | None = Field(None, ge=1, description="Vertex after the last.")


class DistanceQuery(SignatureQuery):
    """Which signatures are compared, and how."""

    to: SequenceId = Field(description="The sequence to compare with.")
    closed: bool = Field(
        True, description="Both are one turn of a cycle; false for a beginning and an end."
    )


class ViewFramesQuery(SignatureQuery):
    """Which frames a page is sent, beside the signature that it shows."""

    first: int = Field(0, ge=0, description="First frame.")
    stop: int | None = Field(None, ge=1, description="Frame after the last; all by default.")


class ReportQuery(SignatureQuery):
    """What a report says beside the signature."""

    model: str | None = Field(
        None,
        max_length=80,
        description="Model whose kept classification is reported: a name, or name@version. None "
        "by default.",
    )


class ReconstructionQuery(SignatureQuery):
    """Query parameters of a reconstruction."""

    times: str | None = Field(
        None,
        max_length=20_000,
        pattern=r"^[0-9eE.+-]+(,[0-9eE.+-]+)*$",
        description="Times in s (frame numbers where there are none), such as 0,0.1,0.25; "
        "those of the frames by default.",
    )
    phases: str | None = Field(
        None,
        max_length=20_000,
        pattern=r"^[0-9eE.+-]+(,[0-9eE.+-]+)*$",
        description="In place of times: rising shares of the cycle, such as 0,0.37. A VTKHDF has "
        "the standard deviation of each vertex's coordinates between frames.",
    )
    frames: int | None = Field(
        None, ge=2, le=1000, description="In place of phases: so many in even steps."
    )
    max_targets: int | None = Field(
        None, ge=0, le=10_000, description="Of a GLB: most morph targets, by energy."
    )
