"""Features of stored sequences as a table."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field

from modalmotion.classification import FeatureTable
from modalmotion.signature.making import MOST_MODES
from modalmotion_service.schemas.fields import JsonBody, SequenceId
from modalmotion_service.schemas.models import LabelledSequence, in_the_longer_form


class FeatureOptions(BaseModel):
    """Which features are read, as `SignatureFeatures` names them."""

    modes: int = Field(7, ge=1, le=MOST_MODES, description="Of the signatures.")
    topology: str | None = Field(
        None, max_length=80, description="Of the signatures; mesh for spring modes."
    )
    kind: Literal["auto", "axis", "summary", "modes", "terms"] = Field(
        "auto",
        description="Parts about the axis, modes in few numbers, modes and their products, or "
        "these and their terms.",
    )
    timing: Literal["auto", "cycle", "transient"] = "auto"
    covariates: Literal["all"] | list[str] | None = Field(
        None, description="Names of covariates that become columns, or all."
    )


class FeaturesRequest(JsonBody, FeatureOptions):
    """Sequences, and which of their features are read."""

    model_config = ConfigDict(extra="forbid")

    sequences: Annotated[list[SequenceId | LabelledSequence], FailFast()] = Field(
        min_length=1,
        description="Ids; label, subject and covariates are those stored with the sequence, or "
        "stated here.",
    )
    on_error: Literal["raise", "leave out"] = Field(
        "raise", description="Whether sequences that do not fit end the request or are left out."
    )

    @property
    def cases(self) -> list[LabelledSequence]:
        """All sequences in the longer form."""
        return in_the_longer_form(self.sequences)

    def options(self) -> dict[str, Any]:
        """Options of the features."""
        return {name: getattr(self, name) for name in FeatureOptions.model_fields}


class FeatureRow(BaseModel):
    """Features of one sequence."""

    case: str
    sequence_id: str
    label: str | None
    subject: str | None
    values: list[float | None] = Field(description="Null where a covariate is unknown.")


class LeftOutAnswer(BaseModel):
    """A sequence that was left out."""

    name: str
    reason: str


class FeaturesAnswer(BaseModel):
    """A table of features."""

    columns: list[str] = Field(description="Names of the features.")
    cases: list[FeatureRow]
    left_out: list[LeftOutAnswer]

    @staticmethod
    def of(table: FeatureTable) -> FeaturesAnswer:
        """Write a table out."""
        return FeaturesAnswer(**table.as_json())
