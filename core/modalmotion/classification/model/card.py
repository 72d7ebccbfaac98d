"""The card of a model: what it was made of, what it is for, and how well it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from modalmotion.arguments.tasks import Plotted
from modalmotion.classification.measures.performance import Interval, Measured
from modalmotion.classification.measures.roc import RocCurve
from modalmotion.numerals import counted
from modalmotion.representation import shown

# Choices of features that are named in words, the weightiest.
_N_NAMED: Final = 3


@shown("classes", "accuracy", "calibration_error", "coverage", "training_set")
@dataclass(frozen=True)
class ModelCard(Plotted):
    """Facts to know about a model before relying on it; every field is JSON-able.

    Parameters
    ----------
    classes : tuple of str
    training_set : str
        sha256 in hex of sequence ids, labels and subjects, in any order.
    n_cases : dict of str to int
        Training cases of each class.
    n_subjects : dict of str to int
        Subjects of each class.
    accuracy, accuracy_interval, confusion, calibration_curve, calibration_error
        Of cross-validation, as in `Performance`; None or empty where there was none.
    is_grouped : bool
        Whether no subject was on both sides of a split.
    coverage : float
        Requested level of the class sets below.
    class_coverage : dict of str to float
        Share of each class whose set held it, in cross-validation.
    mean_set_size : float
    options : dict
        As trained.
    versions : dict of str to str
    intended_use : str
    has_seen : str
    has_not_seen : str
    notes : tuple of str
        Observations from training.
    extra : dict
        Additions by its maker, such as a test on a held-out cohort.
    balanced_accuracy, auc, auc_interval, class_auc, log_loss, log_loss_interval, brier
        Of cross-validation, as in `Performance`.
    brier_interval, sensitivity, specificity, roc
        Likewise.
    methods : str
        How the figures and their intervals are made.
    repetitions : tuple of dict
        Accuracy, AUC, log loss, Brier score and calibration error of each repetition of the
        cross-validation; the figures above are their means.
    learning_curve : tuple of dict
        Of each number of cases a class (`per_class`): accuracy, AUC and log loss of models that
        are fitted to so many, and their ranges over draws. The last point is of all cases.
    fold_choices : tuple of dict
        Of each repetition and fold the choices of features, with their weights.
    confounds : tuple of dict
        Conditions of the recordings, and how well each alone tells the classes apart.
    decision : dict or None
        How probabilities become a label, where it is not the most probable class, and how well
        that does on held-out cases.
    """

    classes: tuple[str, ...]
    training_set: str
    n_cases: dict[str, int]
    n_subjects: dict[str, int]
    accuracy: float | None
    accuracy_interval: Interval | None
    is_grouped: bool
    confusion: tuple[tuple[int, ...], ...]
    calibration_curve: tuple[tuple[float, float, int], ...]
    calibration_error: float | None
    coverage: float
    class_coverage: dict[str, float]
    mean_set_size: float | None
    options: dict[str, Any]
    versions: dict[str, str]
    intended_use: str
    has_seen: str
    has_not_seen: str
    notes: tuple[str, ...] = ()
    extra: dict[str, Any] = field(default_factory=dict)
    balanced_accuracy: float | None = None
    auc: float | None = None
    auc_interval: Interval | None = None
    class_auc: dict[str, Measured] = field(default_factory=dict)
    log_loss: float | None = None
    log_loss_interval: Interval | None = None
    brier: float | None = None
    brier_interval: Interval | None = None
    sensitivity: dict[str, Measured] = field(default_factory=dict)
    specificity: dict[str, Measured] = field(default_factory=dict)
    roc: dict[str, RocCurve] = field(default_factory=dict)
    methods: str = ""
    repetitions: tuple[dict[str, float | None], ...] = ()
    learning_curve: tuple[dict[str, Any], ...] = ()
    fold_choices: tuple[dict[str, Any], ...] = ()
    confounds: tuple[dict[str, Any], ...] = ()
    decision: dict[str, Any] | None = None

    @property
    def reads(self) -> str:
        """The weightiest choices of features, in words; empty where the card has none."""
        choices = self.options.get("features", ())
        parts = [f"{name} (weight {weight:.2f})" for name, weight in choices[:_N_NAMED]]
        if len(choices) > _N_NAMED:
            more = counted(len(choices) - _N_NAMED, "further choice")
            parts.append(f"{more} of features, each of less weight")
        return " and ".join(parts)

    def as_json(self) -> dict[str, Any]:
        """Return the card as JSON-able values, tuples as lists."""
        listed: dict[str, Any] = _lists(asdict(self))
        return listed

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> ModelCard:
        """Read the output of `as_json`."""
        return ModelCard(**{name: _tuples(value) for name, value in values.items()})


def _lists(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _lists(v) for k, v in value.items()}
    return [_lists(v) for v in value] if isinstance(value, list | tuple) else value


def _tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _tuples(v) for k, v in value.items()}
    return tuple(_tuples(v) for v in value) if isinstance(value, list | tuple) else value
