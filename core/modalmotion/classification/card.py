"""The card of a model: what it was made of, what it is for, and how well it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from modalmotion.arguments.checking import Plotted
from modalmotion.classification.performance import Curve, Interval, Measured, RocCurve
from modalmotion.representation import shown

# Tables of features that are named in words, the weightiest.
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
    coverage : float
        Requested level of the class sets below.
    options : dict
        As trained, and under "features" the tables with their weights.
    versions : dict of str to str
    intended_use : str
    has_seen : str
    has_not_seen : str
    is_grouped : bool
        Whether no subject was on both sides of a split.
    class_coverage : dict of str to float
        Share of each class whose set held it, in cross-validation.
    mean_set_size : float
    notes : tuple of str
        Observations from training.
    extra : dict
        Additions by its maker, such as a test on a held-out cohort.
    accuracy, accuracy_interval, confusion, calibration_curve, calibration_error
        Of cross-validation, as in `Performance`; None or empty if there was none.
    balanced_accuracy, auc, auc_interval, class_auc, log_loss, log_loss_interval, brier
        Likewise.
    brier_interval, sensitivity, specificity, roc
        Likewise.
    methods : str
        How the figures and their intervals are made.
    repetitions : tuple of dict
        Accuracy, AUC, log loss, Brier score and calibration error of each repetition of the
        cross-validation; the figures above are their means.
    confounds : tuple of dict
        Conditions of the recordings, and how well each alone separates the classes.
    """

    classes: tuple[str, ...]
    training_set: str
    n_cases: dict[str, int]
    n_subjects: dict[str, int]
    coverage: float
    options: dict[str, Any]
    versions: dict[str, str]
    intended_use: str
    has_seen: str
    has_not_seen: str
    is_grouped: bool = False
    class_coverage: dict[str, float] = field(default_factory=dict)
    mean_set_size: float | None = None
    notes: tuple[str, ...] = ()
    extra: dict[str, Any] = field(default_factory=dict)
    accuracy: float | None = None
    accuracy_interval: Interval | None = None
    confusion: tuple[tuple[int, ...], ...] = ()
    calibration_curve: Curve = ()
    calibration_error: float | None = None
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
    confounds: tuple[dict[str, Any], ...] = ()

    @property
    def reads(self) -> str:
        """What the model reads, in words, the weightiest first."""
        choices = self.options.get("features", ())
        parts = [f"{name} ({weight:.0%})" for name, weight in choices[:_N_NAMED]]
        more = len(choices) - _N_NAMED
        return "; ".join(parts) + (f"; {more} more of less weight" if more > 0 else "")

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
