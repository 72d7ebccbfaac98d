"""Models: requests to train one, and descriptions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field, StringConstraints

from modalmotion.choice.parameters import parameters_as_json
from modalmotion.classification import ModelCard, TrainingOptions
from modalmotion.store import NAME_PATTERN, VERSION_PATTERN, KeptModel, ModelRecord
from modalmotion_service.schemas.facts import COVARIATES
from modalmotion_service.schemas.fields import JsonBody, SequenceId

ModelName = Annotated[str, StringConstraints(pattern=f"^{NAME_PATTERN}$")]
ModelVersion = Annotated[str, StringConstraints(pattern=f"^{VERSION_PATTERN}$")]

_LONGEST_NAME: Final = 200


class LabelledSequence(JsonBody):
    """A stored sequence, with label and subject for this training."""

    id: SequenceId
    label: str | None = Field(
        None, min_length=1, max_length=_LONGEST_NAME, description="Its own by default."
    )
    subject: str | None = Field(
        None, min_length=1, max_length=_LONGEST_NAME, description="Its own by default."
    )
    # Their values are checked by the library, which stops at the first fault.
    covariates: dict[str, Any] | None = Field(
        None, description=f"Over those stored with it. {COVARIATES}"
    )


def in_the_longer_form(
    sequences: Sequence[SequenceId | LabelledSequence],
) -> list[LabelledSequence]:
    """Write sequences that may be named by their ids alone as labelled ones."""
    return [
        case if isinstance(case, LabelledSequence) else LabelledSequence(id=case)
        for case in sequences
    ]


class TrainingRequest(JsonBody):
    """Name, sequences and options of a model to train."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "name": "wall-motion",
                    "sequences": ["0" * 64, {"id": "1" * 64, "label": "akinesia"}],
                    "options": {"modes": 7, "timing": "cycle"},
                }
            ]
        },
    )

    name: str = Field(
        min_length=1,
        max_length=_LONGEST_NAME,
        description="1 to 64 lower-case letters, digits, '.', '_' and '-'. A name that is known "
        "gets its next version.",
    )
    sequences: Annotated[list[SequenceId | LabelledSequence], FailFast()] = Field(
        description="Ids; label, subject and covariates are those stored with the sequence, or "
        "stated here. "
        "Sequences of one subject are never on both sides of a split."
    )
    options: dict[str, Any] = Field(
        default_factory=dict,
        description="Where they differ from "
        + ", ".join(f"{name} {value!r}" for name, value in TrainingOptions().as_json().items())
        + ".",
    )

    @property
    def cases(self) -> list[LabelledSequence]:
        """All sequences in the longer form."""
        return in_the_longer_form(self.sequences)


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
            links={"self": f"{here}/versions/{record.version}", "newest": here},
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
    """How well a condition of the recordings alone tells the classes apart."""

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


class ModelPageAnswer(BaseModel):
    """A page of the list of models."""

    models: list[ModelSummary]
    cursor: str | None = Field(description="For the next page; null on the last.")
