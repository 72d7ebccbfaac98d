"""Comparison of two models on the same labelled cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from math import lgamma, log
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.answer.classifier import classify
from modalmotion.classification.evaluation.evaluation import (
    CaseAnswer,
    Evaluation,
    evaluation_of,
    require_known,
)
from modalmotion.classification.measures.performance import Answers
from modalmotion.classification.model.model import Model
from modalmotion.classification.training.cases import AnyCase, TrainingCase
from modalmotion.classification.training.left_out import LeftOut
from modalmotion.classification.usable_cases import cases_for_models
from modalmotion.errors import ParameterError
from modalmotion.representation import shown

_N_RESAMPLES: Final = 2000

# Resamples of all cases that are in memory at once.
_AT_ONCE: Final = 2_000_000

_SEED: Final = 0

COMPARISON_METHODS: Final = (
    "Differences are the second model's figure less the first's, on the same cases. Intervals of "
    "95 %: percentiles of 2,000 paired resamples of the subjects, all cases of a subject together. "
    "p of AUC, log loss and Brier score: twice the smaller share of resamples on one side of 0. "
    "p of the accuracy: McNemar's exact test; where subjects have several cases, the exact "
    "test that exchanges the two models' answers for whole subjects, which is McNemar's where "
    "each has one."
)
"""How a comparison is made."""


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
        Macro, each class against the rest; None where only one class is there.
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
    answers: tuple[list[CaseAnswer], list[CaseAnswer]] = ([], [])
    models = first, second
    read: Iterable[tuple[int, tuple[TrainingCase, ...]]]
    read = ((n, (c if isinstance(c, TrainingCase) else c.read(),) * 2) for n, c in enumerate(cases))
    if left_out is not None:
        read = cases_for_models(models, cases, left_out)
    for number, pair in read:
        for model, case, its in zip(models, pair, answers, strict=True):
            require_known(model, case.label, number, case.name)
            its.append(CaseAnswer.of(case, classify(case.motion, model, coverage)))
        if progress is not None:
            progress(float(number + 1), "classified by both")
    return comparison_of(
        evaluation_of(first, answers[0], coverage), evaluation_of(second, answers[1], coverage)
    )


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
    subjects = [case.subject for case in first.cases]
    # Only these occur, and both know them.
    classes = tuple(sorted({case.truth for case in first.cases}))
    one = _answers(first, first.cases, classes)
    other = _answers(second, second.cases, classes)
    y = np.array([classes.index(case.truth) for case in first.cases])
    weights = _resamples(subjects)
    right = [answers.right[0].astype(np.float64) for answers in (one, other)]
    accuracy = _difference(right, weights)._replace(p=_exchange_p(right[1] - right[0], subjects))
    n_subjects = len(set(subjects))
    notes = []
    if n_subjects < 10:
        notes.append(
            f"{n_subjects} subject{'s' if n_subjects > 1 else ''}: resampling so few understates "
            "how uncertain the differences are."
        )
    notes += [f"{each.model}: {note}" for each in (first, second) for note in each.notes]
    return Comparison(
        models=(first.model, second.model),
        model_ids=(first.model_id, second.model_id),
        n_cases=first.n_cases,
        n_subjects=n_subjects,
        accuracy=accuracy,
        auc=_auc_difference(one.shares, other.shares, y, weights),
        log_loss=_difference([one.log_losses, other.log_losses], weights),
        brier=_difference([one.briers, other.briers], weights),
        only_first=int(((right[0] == 1) & (right[1] == 0)).sum()),
        only_second=int(((right[1] == 1) & (right[0] == 0)).sum()),
        evaluations=(first, second),
        methods=COMPARISON_METHODS,
        notes=tuple(notes),
    )


class _Side(NamedTuple):
    right: NDArray[np.bool_]
    log_losses: NDArray[np.float64]
    briers: NDArray[np.float64]
    shares: NDArray[np.float64]


def _answers(result: Evaluation, cases: Sequence[CaseAnswer], classes: tuple[str, ...]) -> _Side:
    """Each case's figures over the classes of the model, and its shares of those that occur."""
    place = {label: k for k, label in enumerate(result.classes)}
    answers = Answers(
        result.classes,
        np.array([place[case.truth] for case in cases]),
        [case.subject for case in cases],
        np.array([[case.probabilities for case in cases]]),
        np.array([[-1 if c.answer is None else place[c.answer] for c in cases]]),
    )
    shares = answers.probabilities[0][:, [place[label] for label in classes]]
    return _Side(answers.right, answers.log_losses[0], answers.briers[0], shares)


def _resamples(subjects: Sequence[str]) -> NDArray[np.float64]:
    """How often each case is drawn, (1 + resamples, cases); first, each once."""
    _, place = np.unique(np.asarray(subjects), return_inverse=True)
    m = int(place.max()) + 1
    draws = np.random.default_rng(_SEED).multinomial(m, np.full(m, 1.0 / m), size=_N_RESAMPLES)
    weights: NDArray[np.float64] = np.vstack([np.ones(m), draws])[:, place]
    return weights


def _difference(values: Sequence[NDArray[np.float64]], weights: NDArray[np.float64]) -> Difference:
    """Difference of two means over cases."""
    totals = weights.sum(axis=1)
    first, second = (weights @ value / totals for value in values)
    return _of_resamples(first, second)


def _of_resamples(first: NDArray[np.float64], second: NDArray[np.float64]) -> Difference:
    apart = second - first
    drawn = apart[1:][np.isfinite(apart[1:])]
    low, high = np.quantile(drawn, [0.025, 0.975]) if len(drawn) else (-np.inf, np.inf)
    n = len(drawn)
    tails = [(1 + int(side.sum())) / (n + 1) for side in (drawn <= 0, drawn >= 0)]
    return Difference(
        float(first[0]),
        float(second[0]),
        float(apart[0]),
        float(low),
        float(high),
        min(1.0, 2 * min(tails)),
    )


def _auc_difference(
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    y: NDArray[np.int64],
    weights: NDArray[np.float64],
) -> Difference | None:
    """Difference of the macro areas; a resample counts the classes that it has."""
    if len(np.unique(y)) < 2:
        return None
    areas = []
    for shares in (first, second):
        by_class = [_weighted_areas(shares[:, k], y == k, weights) for k in range(shares.shape[1])]
        stacked = np.array(by_class)
        known = np.isfinite(stacked)
        total = np.where(known, stacked, 0.0).sum(axis=0)
        counts = known.sum(axis=0)
        areas.append(np.divide(total, counts, out=np.full(len(total), np.nan), where=counts > 0))
    return _of_resamples(areas[0], areas[1])


def _weighted_areas(
    scores: NDArray[np.float64], is_class: NDArray[np.bool_], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Area under the ROC curve for each row of weights; NaN where one side is not drawn."""
    values, place = np.unique(scores, return_inverse=True)
    order = np.argsort(place, kind="stable")
    starts = np.searchsorted(place[order], np.arange(len(values)))
    areas = np.empty(len(weights))
    step = max(1, _AT_ONCE // len(scores))
    for start in range(0, len(weights), step):
        rows = weights[start : start + step][:, order]
        hits = np.add.reduceat(rows * is_class[order], starts, axis=1)
        rest = np.add.reduceat(rows * ~is_class[order], starts, axis=1)
        below = np.cumsum(rest, axis=1) - rest / 2
        pairs = hits.sum(axis=1) * rest.sum(axis=1)
        area = (hits * below).sum(axis=1)
        areas[start : start + step] = np.divide(
            area, pairs, out=np.full(len(area), np.nan), where=pairs > 0
        )
    return areas


def _exchange_p(gains: NDArray[np.float64], subjects: Sequence[str]) -> float:
    """Exact p of the sum of gains where each subject's could as well have the other sign.

    Parameters
    ----------
    gains : (cases,) float64
        -1, 0 or 1: whether only the first model is right, or only the second.
    subjects : sequence of str
    """
    _, place = np.unique(np.asarray(subjects), return_inverse=True)
    sums = np.abs(np.bincount(place, gains)).astype(np.int64)
    total = int(sums.sum())
    # chances[s] that the sum of the signed numbers is s - total: of n alike a binomial.
    chances: NDArray[np.float64] = np.ones(1)
    for size, n in zip(*np.unique(sums[sums > 0], return_counts=True), strict=True):
        part = np.zeros(2 * n * size + 1)
        logs = [lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1) for k in range(n + 1)]
        part[:: 2 * size] = np.exp(np.array(logs) - n * log(2))
        chances = np.convolve(chances, part).astype(np.float64)
    reached = abs(int(gains.sum()))
    away = np.abs(np.arange(2 * total + 1) - total)
    return float(min(1.0, chances[away >= reached].sum()))
