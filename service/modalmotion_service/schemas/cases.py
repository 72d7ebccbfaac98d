"""Requests about many stored sequences: trainings, tests, norms, tables of features."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, TypeVar

from pydantic import FailFast, Field

from modalmotion.classification import TrainingOptions
from modalmotion.signature.parameters import MOST_MODES
from modalmotion_service.schemas.from_core import (
    JsonBody,
    ModelName,
    SequenceId,
    model_of,
)
from modalmotion_service.schemas.requests import COVARIATES, LONGEST_NAME, Name

Options = TypeVar("Options", bound=JsonBody)


class LabelledSequence(JsonBody):
    """A stored sequence, with label and subject for this request."""

    id: SequenceId
    label: Name | None = Field(None, min_length=1, description="Its own by default.")
    subject: Name | None = Field(None, min_length=1, description="Its own by default.")
    # Their values are checked by the library, which stops at the first fault.
    covariates: dict[str, Any] | None = Field(
        None, description=f"Over those stored with it. {COVARIATES}"
    )


class CasesRequest(JsonBody):
    """Sequences of a request, by their ids or with what is stated of them."""

    sequences: Annotated[list[SequenceId | LabelledSequence], FailFast()] = Field(
        description="Ids; label, subject and covariates are those stored with the sequence, or "
        "stated here. Sequences of one subject are never on both sides of a split."
    )

    @property
    def cases(self) -> list[LabelledSequence]:
        """All sequences in the longer form."""
        return [
            case if isinstance(case, LabelledSequence) else LabelledSequence(id=case)
            for case in self.sequences
        ]

    def without_cases(self, kind: type[Options]) -> Options:
        """Give all but the sequences."""
        known = self.model_dump(include=set(kind.model_fields), exclude_unset=True)
        return kind.model_validate(known)


class TrainingOptionsBody(JsonBody):
    """How a model is trained."""

    def options(self) -> TrainingOptions:
        """Translate to the library's options.

        Raises
        ------
        ParameterError
            If one is out of range.
        """
        return TrainingOptions.from_json(self.model_dump(mode="json", exclude_unset=True))


TRAINING: Final = model_of(TrainingOptionsBody, TrainingOptions)


class TrainingRequest(CasesRequest):
    """Name, sequences and options of a model to train."""

    name: str = Field(
        min_length=1,
        max_length=LONGEST_NAME,
        description="1 to 64 lower-case letters, digits, '.', '_' and '-'. A name that is known "
        "gets its next version.",
    )
    if TYPE_CHECKING:
        options: TrainingOptionsBody
    else:
        options: TRAINING = Field(default_factory=TRAINING)


class EvaluationOptions(JsonBody):
    """Level of the class sets of a test, and a model beside the tested one."""

    coverage: float = Field(0.9, gt=0, lt=1, description="Level of the class sets.")
    compare_with: str | None = Field(
        None, max_length=100, description="Another model that is tested too: name or name@version."
    )


class EvaluationRequest(CasesRequest, EvaluationOptions):
    """Labelled sequences to test a model on, or to compare it with another on."""


class NormOptions(JsonBody):
    """Name and modes of a norm."""

    name: ModelName = Field(
        description="1 to 64 lower-case letters, digits, '.', '_' and '-', of no other norm."
    )
    modes: int = Field(7, ge=1, le=MOST_MODES, description="Of the signatures.")
    topology: str | None = Field(
        None,
        max_length=80,
        description="Of the signatures; mesh for spring modes. All controls decide it together "
        "by default.",
    )


class NormRequest(CasesRequest, NormOptions):
    """Name, controls and modes of a norm to make; one recording of each control."""


class DeviationOptions(JsonBody):
    """How rare a deviation is."""

    level: float = Field(
        0.05,
        gt=0,
        le=0.5,
        description="Share of recordings like the controls that may be called a deviation.",
    )


class DeviationRequest(CasesRequest, DeviationOptions):
    """Recordings to compare with a norm, each, and from five on together."""


class FeatureOptions(JsonBody):
    """Which features are read, as `SignatureFeatures` names them."""

    modes: int = Field(7, ge=1, le=MOST_MODES, description="Of the signatures.")
    topology: str | None = Field(
        None, max_length=80, description="Of the signatures; mesh for spring modes."
    )
    kind: Literal["auto", "axis", "summary", "modes", "terms"] = Field(
        "auto",
        description="Parts about the axis of the motion, modes in few numbers, modes, or modes "
        "and their terms.",
    )
    timing: Literal["auto", "cycle", "transient"] = "auto"
    covariates: Literal["all"] | list[str] | None = Field(
        None, description="Names of covariates that become columns, or all."
    )
    on_error: Literal["raise", "leave out"] = Field(
        "raise", description="Whether sequences that do not fit end the request or are left out."
    )

    def options(self) -> dict[str, Any]:
        """Options of the library's features."""
        return self.model_dump(exclude={"on_error"})


class FeaturesRequest(CasesRequest, FeatureOptions):
    """Sequences, and which of their features are read."""
