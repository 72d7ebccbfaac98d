"""Models, norms and tables of features: what is said of them, and by them."""

from __future__ import annotations

from typing import Any, Final, Literal

from pydantic import BaseModel, Field

from modalmotion.classification import (
    Comparison,
    Evaluation,
    FeatureTable,
    ModelCard,
)
from modalmotion.norm import Norm
from modalmotion.signature.parameters import parameters_as_json
from modalmotion.store import KeptModel, ModelRecord
from modalmotion_service.schemas.from_core import Paged

_LONGEST_NAME: Final = 200


class ModelSummary(BaseModel):
    """One version of a model: in a list, the newest of its name."""

    name: str
    version: int
    id: str = Field(description="sha256 of everything that its answers depend on.")
    origin: Literal["trained", "shipped"]
    classes: list[str]
    created: str | None = Field(description="ISO 8601 in UTC; null for a shipped model.")
    versions: list[int] = Field(description="All of its name.")
    links: dict[str, str]

    @staticmethod
    def of(record: ModelRecord, versions: list[int]) -> ModelSummary:
        """Write a record out."""
        here = f"/v1/models/{record.name}"
        return ModelSummary(
            name=record.name,
            version=record.version,
            id=record.id,
            origin="trained" if record.created else "shipped",
            classes=list(record.classes),
            created=record.created or None,
            versions=versions,
            links={"self": f"{here}@{record.version}", "newest": here},
        )


class CalibrationPoint(BaseModel):
    """Answers of about the same stated probability."""

    probability: float = Field(description="Mean stated probability.")
    right: float = Field(description="Share that was right.")
    n_cases: int


class Measured(BaseModel):
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float


class RepetitionAnswer(BaseModel):
    """Figures of one repetition of the cross-validation."""

    accuracy: float
    auc: float | None
    log_loss: float
    brier: float
    calibration_error: float


class ConfoundAnswer(BaseModel):
    """How well a condition of the recordings alone separates the classes."""

    name: str
    auc: float = Field(description="Macro.")
    chance: float = Field(description="The mean AUC where classes are exchanged.")
    p: float
    p_holm: float = Field(description="p, corrected for the number of conditions.")
    n_known: int = Field(description="Cases that state it.")
    text: str


_BY_CLASS: Final = ("class_auc", "sensitivity", "specificity")


class PerformanceAnswer(BaseModel):
    """Figures of answers to labelled sequences; `methods` says how they are made."""

    accuracy: float | None = Field(
        description="A card's of cross-validation, null where there was none."
    )
    accuracy_interval: tuple[float, float] | None = Field(
        description="95 %, wider where several sequences are of one subject."
    )
    balanced_accuracy: float | None = Field(None, description="Mean of the sensitivities.")
    auc: float | None = Field(None, description="Macro, each class against the rest.")
    auc_interval: tuple[float, float] | None = None
    class_auc: dict[str, Measured] = Field(default_factory=dict)
    log_loss: float | None = Field(None, description="Nats.")
    log_loss_interval: tuple[float, float] | None = None
    brier: float | None = Field(None, description="Brier score, summed over classes: 0 to 2.")
    brier_interval: tuple[float, float] | None = None
    sensitivity: dict[str, Measured] = Field(default_factory=dict)
    specificity: dict[str, Measured] = Field(default_factory=dict)
    confusion: list[list[int]] = Field(
        description="Rows are true classes, columns answers, in the order of the classes; an "
        "extra last column counts answers without a class. Of repeated folds the sum."
    )
    roc: dict[str, list[tuple[float, float]]] = Field(
        default_factory=dict, description="1 - specificity and sensitivity at falling thresholds."
    )
    calibration_curve: list[CalibrationPoint] = Field(description="Bins of equal count.")
    calibration_error: float | None = Field(description="Expected calibration error.")
    methods: str = ""

    @staticmethod
    def written(values: dict[str, Any]) -> dict[str, Any]:
        """Name the parts of intervals and curves."""
        points = CalibrationPoint.model_fields
        return {
            **values,
            "calibration_curve": [
                dict(zip(points, point, strict=True)) for point in values["calibration_curve"]
            ],
            **{
                name: {
                    label: dict(zip(Measured.model_fields, figure, strict=True))
                    for label, figure in values[name].items()
                }
                for name in _BY_CLASS
            },
        }


class ModelCardAnswer(PerformanceAnswer):
    """Facts to know before relying on a model."""

    training_set: str = Field(
        description="sha256 of sequence ids, labels and subjects, in any order."
    )
    n_cases: dict[str, int] = Field(description="Training sequences of each class.")
    n_subjects: dict[str, int] = Field(description="Subjects of each class.")
    is_grouped: bool = Field(description="Whether no subject was on both sides of a split.")
    repetitions: list[RepetitionAnswer] = Field(
        description="Of the cross-validation; the figures are their means."
    )
    confounds: list[ConfoundAnswer] = Field(description="Stated conditions of the recordings.")
    coverage: float = Field(description="Level of the class sets below.")
    class_coverage: dict[str, float] = Field(
        description="Share of each class whose set held it, in cross-validation."
    )
    mean_set_size: float | None
    options: dict[str, Any] = Field(description="As trained.")
    versions: dict[str, str] = Field(description="Of the libraries that trained it.")
    intended_use: str
    has_seen: str
    has_not_seen: str
    notes: list[str] = Field(description="Remarks from training.")
    extra: dict[str, Any]

    @staticmethod
    def of(card: ModelCard) -> ModelCardAnswer:
        """Write a card out."""
        return ModelCardAnswer(**PerformanceAnswer.written(card.as_json()))


class ModelAnswer(ModelSummary):
    """One version of a model, with its card."""

    parameters: dict[str, Any] = Field(description="Of the signatures that it reads.")
    card: ModelCardAnswer
    file: str | None = Field(
        description="HDF5 file within the data folder; null for a shipped model."
    )

    @staticmethod
    def with_card(model: KeptModel, versions: list[int], file: str | None) -> ModelAnswer:
        """Write a stored model out."""
        return ModelAnswer(
            **ModelSummary.of(model.record, versions).model_dump(),
            parameters=parameters_as_json(model.record.parameters),
            card=ModelCardAnswer.of(ModelCard.from_json(model.card)),
            file=file,
        )


class ModelPageAnswer(Paged):
    """A page of the list of models."""

    models: list[ModelSummary]


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


class NormAnswer(BaseModel):
    """A norm, without any control's features."""

    name: str
    id: str = Field(description="sha256 of everything that its answers depend on.")
    n_controls: int
    topology: str
    n_modes: int
    features: str = Field(description="Kind of the features, in words.")
    groups: list[str] = Field(description="Groups of features that are answered one by one.")
    covariates: list[str] = Field(description="Those that all controls state.")
    smallest_level: float = Field(description="The smallest p-value that is possible.")
    has_volumes: bool = Field(description="Whether every control has its share of the volume.")
    notes: list[str]
    links: dict[str, str]

    @staticmethod
    def of(norm: Norm) -> NormAnswer:
        """Write a norm out."""
        return NormAnswer(**norm.as_json(), links={"self": f"/v1/norms/{norm.name}"})


class NormLink(BaseModel):
    """A norm in a list."""

    name: str
    links: dict[str, str]


class NormPageAnswer(Paged):
    """A page of the list of norms, by name."""

    norms: list[NormLink]


class GroupDeviationAnswer(BaseModel):
    """One group of features beside the controls'."""

    name: str
    p: float = Field(description="Corrected for the number of groups.")
    p_alone: float
    share_less: float = Field(description="Share of the controls with less of it.")
    deviates: bool
    words: str


class QuantityDeviationAnswer(BaseModel):
    """A clinical quantity beside the controls'."""

    name: str
    value: float
    unit: str
    p: float = Field(description="Two-sided, of this quantity alone.")
    share_less: float = Field(description="Share of the controls with a smaller one.")


class DeviationAnswer(BaseModel):
    """A recording beside controls."""

    norm: str
    norm_id: str
    sequence_id: str
    n_controls: int = Field(description="Without the recording itself, where it is one of them.")
    level: float
    attainable: float = Field(
        description="Share of recordings like the controls that is called a deviation."
    )
    p: float = Field(description="Share of controls and recording that is at least as strange.")
    deviates: bool
    groups: list[GroupDeviationAnswer]
    quantities: list[QuantityDeviationAnswer]
    covariates: list[str] = Field(description="Those that are accounted for.")
    warnings: list[str] = Field(description="In what it was not recorded like the controls.")
    notes: list[str]


class CohortDeviationAnswer(BaseModel):
    """Recordings beside controls, each and together."""

    norm: str
    norm_id: str
    n_controls: int
    n_recordings: int
    level: float
    p: float | None = Field(
        description="That exchanging controls and recordings sets them as far apart, by chance; "
        "null of fewer than five recordings."
    )
    is_another: bool | None = Field(
        description="Whether another machine, protocol or group of people stands behind: then "
        "single p-values speak of the cohort."
    )
    warning: str | None = Field(description="The same in words.")
    deviations: list[DeviationAnswer] = Field(description="In the order of the request.")


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
