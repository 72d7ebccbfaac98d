"""Compressed streams and classes."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from modalmotion.classification import DEFAULT_MODEL, FLAGS, Classification
from modalmotion.classification.model_files import RULE
from modalmotion.codec import Effort, Encoded
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion_service.schemas.facts import COVARIATES
from modalmotion_service.schemas.fields import JsonBody
from modalmotion_service.schemas.sequences import ReadingAnswer


class EncodingTarget(BaseModel):
    """At what error, or at what size, to encode: one of the three."""

    model_config = ConfigDict(extra="forbid")

    rms: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="RMS distance of all vertices, not exceeded."
    )
    max_error: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="Distance of any vertex, never exceeded."
    )
    bytes: int | None = Field(None, gt=0, description="Size of the stream, not exceeded.")
    effort: Effort = Field(
        Effort.BALANCED,
        description="How many transforms are tried: fast takes a third of the time, in more bits.",
    )


class EncodedAnswer(BaseModel):
    """Size and errors of a stream, measured by decoding it; sent as headers beside it."""

    n_bytes: int
    bits_per_vertex_and_frame: float
    rms: float
    max_error: float
    kg_error: float
    transform: str

    @staticmethod
    def of(stream: Encoded) -> EncodedAnswer:
        """Write the measurements out."""
        return EncodedAnswer.model_validate(stream, from_attributes=True)

    @property
    def headers(self) -> dict[str, str]:
        """As headers: Encoded-RMS, Encoded-Max-Error, ..."""
        return {
            f"Encoded-{name.replace('_', '-').title()}": str(value)
            for name, value in self.model_dump().items()
        }


class ModelQuery(JsonBody):
    """The model, and how sure its class set must be."""

    model: str = Field(
        DEFAULT_MODEL,
        max_length=100,
        description=f"Name of a model for its newest version, or name@version. {RULE}",
    )
    coverage: float = Field(
        0.9,
        gt=0,
        lt=1,
        description="Probability that the class set holds the true class, for every class.",
    )


class ClassificationRequest(ModelQuery):
    """The model, how sure its class set must be, and what the recording does not carry."""

    # Their values are checked by the library, which stops at the first fault.
    covariates: dict[str, Any] | None = Field(
        None, description=f"Over those stored with the sequence. {COVARIATES}"
    )


class ContributionAnswer(BaseModel):
    """Contribution of one mode, or a cosine-sine pair, to a prediction."""

    modes: list[str]
    score: float = Field(
        description="Added to the log of (probability of the most probable class over that of "
        "the next), beyond those of an average training case."
    )
    amplitude: float = Field(description="RMS over time, in the unit beside it.")
    unit: str | None


class ClassificationAnswer(BaseModel):
    """Answer of a model for one sequence."""

    sequence_id: str
    model: str
    version: int | None = Field(description="Of the model; null if it has been deleted.")
    model_id: str = Field(description="sha256 of the model.")
    label: str | None = Field(description="Most probable class; null where the model abstains.")
    probability: float = Field(description="Of the most probable class.")
    probabilities: dict[str, float]
    class_set: list[str] = Field(description="Classes that cannot be ruled out at `coverage`.")
    coverage: float = Field(description="Probability that the set holds the true class.")
    flags: list[str] = Field(description=f"{', '.join(FLAGS)}; with any of them there is no label.")
    explanation: list[ContributionAnswer] = Field(
        description="Modes that moved the prediction, the strongest first."
    )
    notes: list[str]
    provenance: dict[str, str]
    intended_use: str = INTENDED_USE
    file: str | None = Field(
        description="HDF5 file of this result, within the data folder; null if not stored."
    )

    @staticmethod
    def of(result: Classification, version: int | None, file: str | None) -> ClassificationAnswer:
        """Write a classification out."""
        return ClassificationAnswer(
            sequence_id=result.sequence_id,
            model=result.model,
            version=version,
            model_id=result.model_id,
            label=result.label,
            probability=result.probability,
            probabilities=dict(zip(result.classes, result.probabilities.tolist(), strict=True)),
            class_set=list(result.class_set),
            coverage=result.coverage,
            flags=list(result.flags),
            explanation=[
                ContributionAnswer.model_validate(part, from_attributes=True)
                for part in result.explanation
            ],
            notes=list(result.notes),
            provenance=result.provenance,
            file=file,
        )


class UploadClassificationAnswer(ClassificationAnswer):
    """Answer of a model for an upload that is not stored."""

    reading: ReadingAnswer = Field(description="How the upload was read.")


class ClassificationList(BaseModel):
    """All classifications of one sequence."""

    classifications: list[ClassificationAnswer]
