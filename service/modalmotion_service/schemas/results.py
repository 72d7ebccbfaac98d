"""Compressed streams, classes, and answers for many files."""

from __future__ import annotations

from pydantic import BaseModel, Field

from modalmotion.classification import FLAGS, Classification
from modalmotion.codec import Encoded
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion_service.schemas.from_core import Paged, read_from
from modalmotion_service.schemas.general import Problem, ReadingAnswer
from modalmotion_service.schemas.signatures import SignatureAnswer


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
        return read_from(EncodedAnswer, stream)

    @property
    def headers(self) -> dict[str, str]:
        """As headers: Encoded-RMS, Encoded-Max-Error, ..."""
        return {
            f"Encoded-{name.replace('_', '-').title()}": str(value)
            for name, value in self.model_dump().items()
        }


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
    class_set: list[str] = Field(description="Classes that cannot be excluded at `coverage`.")
    coverage: float = Field(description="Probability that the set contains the true class.")
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
        return read_from(
            ClassificationAnswer,
            result,
            version=version,
            probabilities=dict(zip(result.classes, result.probabilities.tolist(), strict=True)),
            explanation=[read_from(ContributionAnswer, part) for part in result.explanation],
            file=file,
        )


class UploadClassificationAnswer(ClassificationAnswer):
    """Answer of a model for an upload that is not stored."""

    reading: ReadingAnswer = Field(description="How the upload was read.")


class ClassificationPageAnswer(Paged):
    """A page of the classifications of a sequence."""

    classifications: list[ClassificationAnswer]


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
