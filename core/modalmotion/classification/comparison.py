"""Comparison of two models on the same labelled cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.classification.cases import AnyCase, LeftOut
from modalmotion.classification.evaluation import (
    Evaluation,
    answers_of,
    evaluation_of,
)
from modalmotion.classification.model import Model
from modalmotion.classification.performance import Answers, auc
from modalmotion.errors import ParameterError
from modalmotion.representation import shown

COMPARISON_METHODS: Final = (
    "Differences are the second model's figure minus the first's, on the same cases. Intervals of "
    "95 % and p of AUC, log loss and Brier score: normal, with the variance of what each subject "
    "adds (of the AUC by DeLong, DeLong and Clarke-Pearson 1988). p of the accuracy: McNemar's "
    "exact test; a subject with several cases counts once, for the model that is right more often."
)
"""How a comparison is made."""


Array = NDArray[np.float64]


class Difference(NamedTuple):
    """A figure of two models.

    Parameters
    ----------
    first, second : float
    difference : float
        Second less first.
    low, high : float
        95 % interval of the difference.
    p : float
        Of no difference, two-sided.
    """

    first: float
    second: float
    difference: float
    low: float
    high: float
    p: float


@shown("models", "n_cases", "accuracy", "auc", "log_loss")
@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two models on the same labelled cases; every field is JSON-able.

    Parameters
    ----------
    models, model_ids : (str, str)
    n_cases, n_subjects : int
    accuracy : Difference
        An abstention counts as wrong.
    auc : Difference or None
        Macro, each class against the rest; None if only one class is there.
    log_loss, brier : Difference
        Smaller is better.
    only_first, only_second : int
        Cases on which that model alone is right.
    evaluations : (Evaluation, Evaluation)
    methods : str
    notes : tuple of str
    """

    models: tuple[str, str]
    model_ids: tuple[str, str]
    n_cases: int
    n_subjects: int
    accuracy: Difference
    auc: Difference | None
    log_loss: Difference
    brier: Difference
    only_first: int
    only_second: int
    evaluations: tuple[Evaluation, Evaluation]
    methods: str
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON-able values."""
        values = asdict(self)
        for name in ("accuracy", "auc", "log_loss", "brier"):
            figure = getattr(self, name)
            values[name] = None if figure is None else figure._asdict()
        return values


def compare_models(
    first: Model,
    second: Model,
    cases: Iterable[AnyCase],
    coverage: float = 0.9,
    progress: Callable[[float, str], None] | None = None,
    left_out: list[LeftOut] | None = None,
) -> Comparison:
    """Test two models on the same cases.

    Parameters
    ----------
    first, second : Model
        Of one task: both know the classes of all cases. They may know others, read other modes
        and be of other topologies.
    cases : iterable of TrainingCase or CaseSource
        Of subjects that neither was trained on; sequences, where the two read signatures of
        different parameters. Read one by one.
    coverage : float
        Level of the class sets.
    progress : callable, optional
        Called with the number of cases that are done, as a float, and a text.
    left_out : list of LeftOut, optional
        Cases that cannot be used are added to it; else one of them ends the comparison.

    Returns
    -------
    Comparison

    Raises
    ------
    ParameterError
        As `evaluate` says.
    """
    answers = answers_of((first, second), cases, coverage, progress, left_out)
    evaluations = (
        evaluation_of(model, its, coverage)
        for model, its in zip((first, second), answers, strict=True)
    )
    return comparison_of(*evaluations)


def comparison_of(first: Evaluation, second: Evaluation) -> Comparison:
    """Compare two evaluations, case by case.

    Raises
    ------
    ParameterError
        If they are of different cases, or of different labels of these.
    """
    listed = [[(c.sequence_id, c.truth) for c in each.cases] for each in (first, second)]
    if listed[0] != listed[1]:
        raise ParameterError(
            f"The two models were tested on different cases ({first.n_cases} and "
            f"{second.n_cases}), in another order, or with other labels.",
            remedy="Test both on the same cases.",
        )
    _, place = np.unique([case.subject for case in first.cases], return_inverse=True)
    one, other = (each.answers for each in (first, second))
    right = [answers.right[0].astype(np.float64) for answers in (one, other)]
    gains = np.bincount(place, right[1] - right[0])
    won, lost = int((gains > 0).sum()), int((gains < 0).sum())
    p = min(1.0, 2.0 * float(scipy.special.bdtr(min(won, lost), won + lost, 0.5)))
    n_subjects = len(gains)
    notes = []
    if n_subjects < 10:
        notes.append(
            f"{n_subjects} subject{'s' if n_subjects > 1 else ''}: so few understate how uncertain "
            "the differences are."
        )
    notes += [f"{each.model}: {note}" for each in (first, second) for note in each.notes]
    return Comparison(
        models=(first.model, second.model),
        model_ids=(first.model_id, second.model_id),
        n_cases=first.n_cases,
        n_subjects=n_subjects,
        accuracy=_difference(right[0], right[1], place)._replace(p=p),
        auc=_auc_difference(one, other, place),
        log_loss=_difference(one.log_losses[0], other.log_losses[0], place),
        brier=_difference(one.briers[0], other.briers[0], place),
        only_first=int(((right[0] == 1) & (right[1] == 0)).sum()),
        only_second=int(((right[1] == 1) & (right[0] == 0)).sum()),
        evaluations=(first, second),
        methods=COMPARISON_METHODS,
        notes=tuple(notes),
    )


def _difference(first: Array, second: Array, place: NDArray[np.int64]) -> Difference:
    """Difference of two means over cases, which belong to subjects."""
    apart = (second - first) / len(first)
    return _with_interval(float(first.mean()), float(second.mean()), apart - apart.mean(), place)


def _auc_difference(first: Answers, second: Answers, place: NDArray[np.int64]) -> Difference | None:
    """Difference of the macro areas over the classes that occur."""
    names = [first.classes[k] for k in np.unique(first.y)]
    sides = []
    for answers in (first, second):
        found = [
            auc(answers.probabilities[0, :, k], answers.y == k)
            for k in map(answers.classes.index, names)
        ]
        areas = [area for area in found if area is not None]
        if not areas:
            return None
        influences = np.mean([area.influences for area in areas], axis=0)
        sides.append((float(np.mean([area.value for area in areas])), influences))
    (a, own), (b, other) = sides
    return _with_interval(a, b, other - own, place)


def _with_interval(
    first: float, second: float, influences: Array, place: NDArray[np.int64]
) -> Difference:
    """Difference of two figures, of what each case adds to it beyond its share."""
    of_subjects = np.bincount(place, influences)
    m = len(of_subjects)
    error = float(np.sqrt((of_subjects**2).sum() * m / (m - 1))) if m > 1 else np.inf
    apart = second - first
    p = 2.0 * float(scipy.special.ndtr(-abs(apart) / error)) if error > 0 else float(apart == 0)
    half = _Z * error
    return Difference(first, second, apart, apart - half, apart + half, p)


# 97.5 % of a standard normal.
_Z: Final = 1.959963984540054
