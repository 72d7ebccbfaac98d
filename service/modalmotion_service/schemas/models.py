"""Models, norms and tables of features: what is said of them, and by them."""

from collections.abc import Sequence
from typing import Any, Final, Literal

from modalmotion import classification, store
from modalmotion.classification import evaluation
from modalmotion.norm import Norm
from modalmotion.norm.deviations import (
    CohortDeviation,
    Deviation,
    GroupDeviation,
    QuantityDeviation,
)
from modalmotion.notes import Note
from modalmotion.representation import plain
from modalmotion.signature.parameters import parameters_as_json
from modalmotion_service.schemas.from_core import Answer, Paged, mirrors, read_from
from modalmotion_service.schemas.results import FigureAnswer


class ModelSummary(Answer):
    """One version of a model: in a list, the newest of its name."""

    name: str
    version: int
    id: str
    """sha256 of everything that its answers depend on."""
    origin: Literal["trained", "shipped"]
    classes: list[str]
    created: str | None
    """ISO 8601 in UTC; null for a shipped model."""
    versions: list[int]
    """All of its name."""
    links: dict[str, str]

    @staticmethod
    def of(record: store.ModelRecord, versions: list[int]) -> "ModelSummary":
        """Write a record out."""
        here = f"/v1/models/{record.name}"
        return read_from(
            ModelSummary,
            record,
            origin="trained" if record.created else "shipped",
            created=record.created or None,
            versions=versions,
            links={"self": f"{here}@{record.version}", "newest": here},
        )


class CalibrationPoint(Answer):
    """Answers of about the same stated probability."""

    probability: float
    """Mean stated probability."""
    right: float
    """Share that was right."""
    n_cases: int


_BY_CLASS: Final = ("class_auc", "sensitivity", "specificity")


class Curves(Answer):
    """Figures of answers to labelled sequences; `methods` describes how they are computed."""

    class_auc: dict[str, FigureAnswer]
    sensitivity: dict[str, FigureAnswer]
    specificity: dict[str, FigureAnswer]
    calibration_curve: list[CalibrationPoint]

    @staticmethod
    def written(values: dict[str, Any]) -> dict[str, Any]:
        """Name the parts of intervals and curves."""
        points = CalibrationPoint.model_fields
        curve = [dict(zip(points, one, strict=True)) for one in values["calibration_curve"]]
        named = {
            name: {
                label: dict(zip(FigureAnswer.model_fields, figure, strict=True))
                for label, figure in values[name].items()
            }
            for name in _BY_CLASS
        }
        return {**values, **named, "calibration_curve": curve}


@mirrors(classification.ModelCard, without=["classes"])
class ModelCardAnswer(Curves):
    """Facts to know before relying on a model."""

    @staticmethod
    def of(card: classification.ModelCard) -> "ModelCardAnswer":
        """Write a card out."""
        return ModelCardAnswer(**Curves.written(card.as_json()))


class ModelAnswer(ModelSummary):
    """One version of a model, with its card."""

    parameters: dict[str, Any]
    """Of the signatures that it reads."""
    card: ModelCardAnswer
    file: str | None
    """HDF5 file within the data folder; null for a shipped model."""

    @staticmethod
    def with_card(model: store.KeptModel, versions: list[int], file: str | None) -> "ModelAnswer":
        """Write a stored model out."""
        return ModelAnswer(
            **ModelSummary.of(model.record, versions).model_dump(),
            parameters=parameters_as_json(model.record.parameters),
            card=ModelCardAnswer.of(classification.ModelCard.from_json(model.card)),
            file=file,
        )


class ModelPageAnswer(Paged):
    """A page of the list of models."""

    models: list[ModelSummary]


@mirrors(evaluation.CaseAnswer, without=["name"])
class CaseResult(Answer):
    """A model's answer to one labelled sequence."""

    probabilities: dict[str, float]


@mirrors(classification.Evaluation)
class EvaluationAnswer(Curves):
    """A model on labelled sequences. An abstention is wrong, and its probabilities are equal."""

    version: int
    cases: list[CaseResult]

    @staticmethod
    def of(result: classification.Evaluation, version: int) -> "EvaluationAnswer":
        """Write a result out."""
        values = Curves.written(plain(result))
        values["cases"] = [
            {**case, "probabilities": dict(zip(result.classes, case["probabilities"], strict=True))}
            for case in values["cases"]
        ]
        return EvaluationAnswer(**values, version=version)


@mirrors(evaluation.Difference)
class DifferenceAnswer(Answer):
    """A figure of two models; the difference is the second's less the first's."""


@mirrors(classification.Comparison)
class ComparisonAnswer(Answer):
    """Two models on the same labelled sequences; `methods` describes how they are compared."""

    accuracy: DifferenceAnswer
    """p is of McNemar's exact test, by subject."""
    auc: DifferenceAnswer | None
    log_loss: DifferenceAnswer
    brier: DifferenceAnswer
    evaluations: tuple[EvaluationAnswer, EvaluationAnswer]

    @staticmethod
    def of(result: classification.Comparison, versions: Sequence[int]) -> "ComparisonAnswer":
        """Write a result out."""
        values: dict[str, Any] = plain(result)
        values["models"] = tuple(
            f"{name}@{version}" for name, version in zip(result.models, versions, strict=True)
        )
        values["evaluations"] = tuple(map(EvaluationAnswer.of, result.evaluations, versions))
        return ComparisonAnswer(**values)


class NormAnswer(Answer):
    """A norm, without any control's features."""

    name: str
    id: str
    """sha256 of everything that its answers depend on."""
    n_controls: int
    topology: str
    n_modes: int
    features: str
    """Kind of the features, in words."""
    groups: list[str]
    """Groups of features that are answered one by one."""
    covariates: list[str]
    """Those that all controls state."""
    smallest_level: float
    """The smallest p-value that is possible."""
    has_volumes: bool
    """Whether every control has its share of the volume."""
    notes: list[Note]
    links: dict[str, str]

    @staticmethod
    def of(norm: Norm) -> "NormAnswer":
        """Write a norm out."""
        return NormAnswer(**norm.as_json(), links={"self": f"/v1/norms/{norm.name}"})


class NormLink(Answer):
    """A norm in a list."""

    name: str
    links: dict[str, str]


class NormPageAnswer(Paged):
    """A page of the list of norms, by name."""

    norms: list[NormLink]


@mirrors(GroupDeviation)
class GroupDeviationAnswer(Answer):
    """One group of features beside the controls'."""

    words: str


@mirrors(QuantityDeviation)
class QuantityDeviationAnswer(Answer):
    """A clinical quantity beside the controls'."""


@mirrors(Deviation)
class DeviationAnswer(Answer):
    """A recording beside controls."""

    groups: list[GroupDeviationAnswer]
    quantities: list[QuantityDeviationAnswer]


@mirrors(CohortDeviation)
class CohortDeviationAnswer(Answer):
    """Recordings beside controls, each and together; together from five on."""

    p: float | None
    is_another: bool | None
    deviations: list[DeviationAnswer]


class FeatureRow(Answer):
    """Features of one sequence."""

    case: str
    sequence_id: str
    label: str | None
    subject: str | None
    values: list[float | None]
    """Null where a covariate is unknown."""


class LeftOutAnswer(Answer):
    """A sequence that was left out."""

    name: str
    reason: str


class FeaturesAnswer(Answer):
    """A table of features."""

    columns: list[str]
    """Names of the features."""
    cases: list[FeatureRow]
    left_out: list[LeftOutAnswer]

    @staticmethod
    def of(table: classification.FeatureTable) -> "FeaturesAnswer":
        """Write a table out."""
        return FeaturesAnswer(**table.as_json())
