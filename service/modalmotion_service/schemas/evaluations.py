"""Evaluations of models on labelled sequences: requests and answers."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, FailFast, Field

from modalmotion.classification import Comparison, Evaluation
from modalmotion_service.schemas.fields import JsonBody, SequenceId
from modalmotion_service.schemas.models import LabelledSequence, PerformanceAnswer

_SEQUENCES = Field(
    description="Ids; label and subject are those stored with the sequence, or stated here."
)
_COVERAGE = Field(0.9, gt=0, lt=1, description="Level of the class sets.")


class EvaluationRequest(JsonBody):
    """Labelled sequences to test a model on."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [{"sequences": ["0" * 64, {"id": "1" * 64, "label": "akinesia"}]}]
        },
    )

    sequences: Annotated[list[SequenceId | LabelledSequence], FailFast()] = _SEQUENCES
    coverage: float = _COVERAGE

    @property
    def cases(self) -> list[LabelledSequence]:
        """All sequences in the longer form."""
        return [
            case if isinstance(case, LabelledSequence) else LabelledSequence(id=case)
            for case in self.sequences
        ]


class ComparisonRequest(EvaluationRequest):
    """Two models, and labelled sequences to compare them on."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [{"models": ["wall-motion@1", "wall-motion@2"], "sequences": ["0" * 64]}]
        },
    )

    models: tuple[str, str] = Field(description='Two, each as "name" or "name@version".')


class CaseResult(BaseModel):
    """A model's answer to one labelled sequence."""

    sequence_id: str
    subject: str
    truth: str
    answer: str | None = Field(description="null for an abstention.")
    probabilities: dict[str, float]
    class_set: list[str]
    flags: list[str]


class EvaluationAnswer(PerformanceAnswer):
    """A model on labelled sequences. An abstention is wrong, and its probabilities are equal."""

    model: str
    version: int
    model_id: str
    classes: list[str]
    n_cases: int
    n_subjects: int
    abstained: float = Field(description="Share without a label.")
    flagged: dict[str, float] = Field(description="Share with each flag.")
    coverage: float
    class_coverage: dict[str, float] = Field(description="Share of each class whose set held it.")
    mean_set_size: float
    n_empty_sets: int = Field(description="Number of empty class sets.")
    notes: list[str] = Field(description="Caveats, such as sequences that were trained on.")
    cases: list[CaseResult]

    @staticmethod
    def of(result: Evaluation, version: int) -> EvaluationAnswer:
        """Write a result out."""
        values = PerformanceAnswer.written(result.as_json())
        values["cases"] = [
            {**case, "probabilities": dict(zip(result.classes, case["probabilities"], strict=True))}
            for case in values["cases"]
        ]
        return EvaluationAnswer(**values, version=version)


class DifferenceAnswer(BaseModel):
    """A figure of two models; the difference is the second's less the first's."""

    first: float
    second: float
    difference: float
    low: float = Field(description="Of the 95 % interval of the difference.")
    high: float
    p: float = Field(description="Of no difference, two-sided.")


class ComparisonAnswer(BaseModel):
    """Two models on the same labelled sequences; `methods` says how they are compared."""

    models: tuple[str, str] = Field(description="With their versions.")
    model_ids: tuple[str, str]
    n_cases: int
    n_subjects: int
    accuracy: DifferenceAnswer = Field(description="p is of McNemar's exact test, by subject.")
    auc: DifferenceAnswer | None = Field(description="Macro; null where there is one class only.")
    log_loss: DifferenceAnswer
    brier: DifferenceAnswer
    only_first: int = Field(description="Sequences on which the first model alone is right.")
    only_second: int
    evaluations: tuple[EvaluationAnswer, EvaluationAnswer]
    methods: str
    notes: list[str]

    @staticmethod
    def of(result: Comparison, versions: tuple[int, int]) -> ComparisonAnswer:
        """Write a result out."""
        values: dict[str, Any] = result.as_json()
        values["models"] = tuple(
            f"{name}@{version}" for name, version in zip(result.models, versions, strict=True)
        )
        values["evaluations"] = tuple(
            EvaluationAnswer.of(one, version)
            for one, version in zip(result.evaluations, versions, strict=True)
        )
        return ComparisonAnswer(**values)
