"""The fit to some cases of a table: features and estimator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import FeatureReader
from modalmotion.classification.model.domain import Judgement
from modalmotion.classification.options import ClassWeights, Estimator, TrainingOptions
from modalmotion.classification.training.case_groups import inner_groups
from modalmotion.classification.training.domain_fit import fit_domain
from modalmotion.classification.training.readings import best_readings
from modalmotion.classification.training.table import CaseTable

# Standard errors by which the loss of a choice of features must be below that of one that
# depends on less.
_SURE: Final = 1.0

# Cases that choices of features are compared on; more cost time and say little. Beyond some the
# linear estimator compares them, which takes a tenth of the time.
_MOST_COMPARED: Final = 1000
_MOST_COMPARED_FULLY: Final = 150
_FEWEST_COMPARED: Final = 20


@dataclass(frozen=True, eq=False)
class FoldFit:
    """Features and estimator, fitted to some cases.

    Parameters
    ----------
    reader : FeatureReader
        The best of the choices.
    values : (all cases, readings, features) float64
        Its features.
    X : (cases, features) float64
        Of those that were fitted to, each in its reading.
    estimator : MotionClassifier
    classes : (seen,) int64
        Those that the estimator has seen.
    centre, scale : (features,) float64
    """

    reader: FeatureReader
    values: NDArray[np.float64]
    X: NDArray[np.float64]
    estimator: Any
    classes: NDArray[np.int64]
    centre: NDArray[np.float64]
    scale: NDArray[np.float64]

    def read_as(self, rows: NDArray[np.int64], readings: NDArray[np.int64]) -> NDArray[np.float64]:
        """Features of some cases, each in one of its readings."""
        values = self.values[rows]
        if values.shape[1] == 1:
            return values[:, 0]
        return np.asarray(values[np.arange(len(rows)), readings])

    def probabilities(self, X: NDArray[np.float64], n_classes: int) -> NDArray[np.float64]:
        """Probabilities of all classes; 0 for those the fold has not seen."""
        shares = np.zeros((len(X), n_classes))
        shares[:, self.classes] = self.estimator.predict_proba(X)
        return shares


def fit_rows(table: CaseTable, rows: NDArray[np.int64], options: TrainingOptions) -> FoldFit:
    """Fit to some cases, with the best of the table's choices of features.

    The best is the one under which cases that are left out with their group are predicted best.
    Choices come in the order of how much they depend on, and one that depends on more must be
    better by a standard error (Breiman, Friedman, Olshen and Stone, Classification and
    regression trees, 1984). Where there is no loss to compare the first is taken.
    """
    first, *others = table.readers
    if not others:
        return _fit(table, first, rows, options)
    compared = _compared(table, rows, options.seed)
    quick = options
    if len(compared) > _MOST_COMPARED_FULLY and options.estimator == Estimator.AUTO:
        quick = replace(options, estimator=Estimator.LINEAR)
    best = _fit(table, first, compared, quick)
    for choice in others:
        fit = _fit(table, choice, compared, quick)
        if _is_better(fit.estimator.losses_, best.estimator.losses_):
            best = fit
    if len(best.X) == len(rows) and quick is options:
        return best
    return _fit(table, best.reader, rows, options)


def _compared(table: CaseTable, rows: NDArray[np.int64], seed: int) -> NDArray[np.int64]:
    """Take some cases where there are many: of each class its share, but never few."""
    if len(rows) <= _MOST_COMPARED:
        return rows
    rng, parts = np.random.default_rng(seed), []
    for k in np.unique(table.y[rows]):
        mine = rng.permutation(rows[table.y[rows] == k])
        parts.append(mine[: max(_FEWEST_COMPARED, len(mine) * _MOST_COMPARED // len(rows))])
    return np.sort(np.concatenate(parts))


def _fit(
    table: CaseTable, choice: FeatureReader, rows: NDArray[np.int64], options: TrainingOptions
) -> FoldFit:
    from modalmotion.classification.estimators.estimator import MotionClassifier

    y, n_classes = table.y[rows], len(table.classes)
    reader = table.fitted(choice, rows, options.pose)
    values = table.features(reader)
    X = best_readings(values[rows], y, n_classes, table.allowed[rows])
    estimator = MotionClassifier(str(options.estimator), _weights(table, options), options.seed)
    estimator.fit(X, y, inner_groups(y, table.groups[rows]))
    centre, scale = _standards(X)
    return FoldFit(reader, values, X, estimator, estimator.classes_, centre, scale)


class HeldOut(NamedTuple):
    """Answers of one fold to the cases that took no part in its fit.

    Parameters
    ----------
    probabilities : (cases, classes) float64
    judgement : Judgement
        Of the fold's domain.
    choices : tuple of (str, float)
        The choices of features that the fold made, in words, and their weights; these sum to 1.
    """

    probabilities: NDArray[np.float64]
    judgement: Judgement
    choices: tuple[tuple[str, float], ...]


def predict_fold(
    table: CaseTable,
    inner: NDArray[np.int64],
    outer: NDArray[np.int64],
    options: TrainingOptions,
) -> HeldOut:
    """Fit to some cases and predict others."""
    fold = fit_rows(table, inner, options)
    judgement = fit_domain(table, inner).judge(outer)
    X = fold.read_as(outer, judgement.readings)
    return HeldOut(
        fold.probabilities(X, len(table.classes)), judgement, ((fold.reader.description, 1.0),)
    )


def _standards(X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation of each column; infinite where it is constant."""
    centre, spread = X.mean(axis=0), X.std(axis=0)
    return centre, np.where(spread > 1e-12 * np.abs(X).max(axis=0), spread, np.inf)


def _is_better(losses: NDArray[np.float64], known: NDArray[np.float64]) -> bool:
    """Whether the mean loss is surely below the known one's; false where there are no losses."""
    gain = known - losses
    return bool(gain.mean() > _SURE * gain.std() / np.sqrt(len(gain)))


def _weights(table: CaseTable, options: TrainingOptions) -> Any:
    weights = options.class_weights
    if isinstance(weights, Mapping):
        return {table.classes.index(k): w for k, w in weights.items() if k in table.classes}
    return None if weights == ClassWeights.NONE else str(weights)
