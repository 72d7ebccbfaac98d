"""The card of a model: what it was made of, what it is for, and how well it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from modalmotion.representation import shown


@shown("classes", "accuracy", "calibration_error", "coverage", "training_set")
@dataclass(frozen=True)
class ModelCard:
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
    accuracy : float
        Of cross-validation; NaN becomes None where there was none.
    accuracy_interval : (float, float)
        95 % interval, wider where several cases are of one subject.
    is_grouped : bool
        Whether no subject was on both sides of a split.
    confusion : tuple of tuple of int
        Rows are true classes, columns answers, in the order of `classes`.
    calibration_curve : tuple of (float, float, int)
        Mean probability of the label, share that was right, number of cases, by bins.
    calibration_error : float
        Expected calibration error (ECE).
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
    """

    classes: tuple[str, ...]
    training_set: str
    n_cases: dict[str, int]
    n_subjects: dict[str, int]
    accuracy: float | None
    accuracy_interval: tuple[float, float] | None
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
