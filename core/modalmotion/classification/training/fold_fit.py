"""The fit to some cases of a table: several choices of features, weighed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.choice_weights import choice_weights
from modalmotion.classification.estimators.scorer import pooled
from modalmotion.classification.estimators.temperature import fit_temperature, softmax
from modalmotion.classification.features import FeatureReader, Further
from modalmotion.classification.options import ClassWeights, Estimator, TrainingOptions
from modalmotion.classification.training.case_groups import inner_groups
from modalmotion.classification.training.domain_fit import fit_domain
from modalmotion.classification.training.feature_choices import further_kinds, prior_weights
from modalmotion.classification.training.readings import best_readings
from modalmotion.classification.training.table import CaseTable

# Cases that choices of features are compared on; more cost time and say little. Beyond some the
# linear estimator compares them, which takes a tenth of the time.
_MOST_COMPARED: Final = 1000
_MOST_COMPARED_FULLY: Final = 150
_FEWEST_COMPARED: Final = 20

# Subjects of each class below which nothing beside the motion and the volume is read.
_FEWEST_SUBJECTS: Final = 5

# Choices of the motion that others are added to, and the least weight of one that is kept.
_N_EXTENDED: Final = 2
_LEAST_WEIGHT: Final = 0.02


@dataclass(frozen=True, eq=False)
class MemberFit:
    """One choice of features and its estimator, fitted to some cases.

    Parameters
    ----------
    reader : FeatureReader
    values : (all cases, readings, features) float64
        Its features.
    X : (cases, features) float64
        Of those that were fitted to, each in its reading.
    estimator : MotionClassifier
    weight : float
    """

    reader: FeatureReader
    values: NDArray[np.float64]
    X: NDArray[np.float64]
    estimator: Any
    weight: float

    def read_as(self, rows: NDArray[np.int64], readings: NDArray[np.int64]) -> NDArray[np.float64]:
        """Features of some cases, each in one of its readings."""
        values = self.values[rows]
        if values.shape[1] == 1:
            return values[:, 0]
        return np.asarray(values[np.arange(len(rows)), readings])


@dataclass(frozen=True, eq=False)
class FoldFit:
    """Several choices of features, each with its estimator, weighed by cases left out.

    Parameters
    ----------
    members : tuple of MemberFit
        The weightiest first; their weights add up to 1.
    temperature : float
        See `pooled`.
    classes : (seen,) int64
        Those that the estimators have seen.
    """

    members: tuple[MemberFit, ...]
    temperature: float
    classes: NDArray[np.int64]

    def probabilities(
        self, rows: NDArray[np.int64], readings: NDArray[np.int64], n_classes: int
    ) -> NDArray[np.float64]:
        """Probabilities of all classes for some cases of the table; 0 for those not seen."""
        logs = [
            np.log(np.maximum(m.estimator.predict_proba(m.read_as(rows, readings)), 1e-300))
            for m in self.members
        ]
        shares = np.zeros((len(rows), n_classes))
        weights = [m.weight for m in self.members]
        shares[:, self.classes] = softmax(pooled(logs, weights) / self.temperature)
        return shares

    @property
    def choices(self) -> tuple[tuple[str, float], ...]:
        """The choices in words, with their weights."""
        return tuple((m.reader.description, m.weight) for m in self.members)


def fit_rows(table: CaseTable, rows: NDArray[np.int64], options: TrainingOptions) -> FoldFit:
    """Fit to some cases with the table's choices of features, weighed.

    Each choice is weighed by how well it predicts cases that are left out with their group: see
    `choice_weights`. Size, rest shape, volume curve and covariates are added to the weightiest
    choices of the motion, where each class has several subjects.
    """
    compared = _compared(table, rows, options.seed)
    quick = options
    if len(compared) > _MOST_COMPARED_FULLY and options.estimator == Estimator.AUTO:
        quick = replace(options, estimator=Estimator.LINEAR)
    fits = [_fit(table, choice, compared, quick) for choice in table.readers]
    if np.isnan(fits[0].estimator.held_out_).any():
        # Nothing says which is better.
        fits = (
            fits[:1] if len(compared) == len(rows) else [_fit(table, fits[0].reader, rows, options)]
        )
        return FoldFit((replace(fits[0], weight=1.0),), 1.0, fits[0].estimator.classes_)
    fits += [
        _fit(table, choice, compared, quick) for choice in _further(table, fits, compared, options)
    ]
    weights = _weights_of(table, fits, compared, options.seed)
    order = [k for k in np.argsort(-weights, kind="stable") if weights[k] >= _LEAST_WEIGHT]
    kept = [fits[k] for k in order]
    if len(compared) < len(rows) or quick is not options:
        kept = [_fit(table, fit.reader, rows, options) for fit in kept]
    shares = weights[order] / weights[order].sum()
    members = tuple(
        replace(fit, weight=weight) for fit, weight in zip(kept, shares.tolist(), strict=True)
    )
    if len(members) == 1:
        # Its own probabilities are reliable already.
        return FoldFit(members, 1.0, members[0].estimator.classes_)
    y = np.searchsorted(members[0].estimator.classes_, table.y[rows])
    held_out = pooled([m.estimator.held_out_ for m in members], [m.weight for m in members])
    per_class = _case_weights(table, rows, options)
    temperature = fit_temperature(held_out, y, per_class)
    return FoldFit(members, temperature, members[0].estimator.classes_)


def _further(
    table: CaseTable,
    fits: list[MemberFit],
    rows: NDArray[np.int64],
    options: TrainingOptions,
) -> list[FeatureReader]:
    """List choices that read more than the motion, or other than it."""
    if not options.further:
        return []
    n_topologies = len(table.readable.topologies)
    first = replace(table.readers[0], typical=None, reads_motion=False)
    covariates = [table.covariates[i] for i in rows]
    kinds = further_kinds(table.rows, covariates, first, n_topologies)
    alone = [kind for kind in kinds if kind == Further.VOLUME]
    choices = [replace(first, further=(kind,)) for kind in alone]
    y, groups = table.y[rows], table.groups[rows]
    if min(len(np.unique(groups[y == k])) for k in np.unique(y)) < _FEWEST_SUBJECTS:
        return choices
    weights = _weights_of(table, fits, rows, options.seed)
    best = [fits[k].reader for k in np.argsort(-weights, kind="stable")[:_N_EXTENDED]]
    sets = _beside(kinds)
    choices += [replace(base, further=beside) for base in best for beside in sets]
    apart = replace(first, n_modes=best[0].n_modes)
    return choices + [
        replace(apart, further=beside) for beside in sets if beside != (Further.VOLUME,)
    ]


def _beside(kinds: tuple[Further, ...]) -> list[tuple[Further, ...]]:
    """List sets of kinds that are tried, each only if the cases have all of it."""
    still = (Further.SIZE, Further.REST_SHAPE)
    volume = (Further.VOLUME, Further.VOLUME_CURVE)
    sets = [still, volume[:1], volume, still + volume, (Further.SIZE,)]
    known = [one for one in sets if set(one) <= set(kinds)]
    if Further.COVARIATES in kinds:
        known += [(Further.COVARIATES,), *((*one, Further.COVARIATES) for one in known[:1])]
        known += [(*volume[:1], Further.COVARIATES)] if Further.VOLUME in kinds else []
    return list(dict.fromkeys(known))


def _weights_of(
    table: CaseTable, fits: list[MemberFit], rows: NDArray[np.int64], seed: int
) -> NDArray[np.float64]:
    losses = np.stack([fit.estimator.losses_ for fit in fits])
    prior = prior_weights([fit.reader for fit in fits])
    # A loss may be infinite where a class has no share left.
    return choice_weights(np.minimum(losses, 30.0), prior, table.groups[rows], seed)


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
) -> MemberFit:
    from modalmotion.classification.estimators.estimator import MotionClassifier

    y, n_classes = table.y[rows], len(table.classes)
    reader = table.fitted(choice, rows, options.pose)
    values = table.features(reader)
    X = best_readings(values[rows], y, n_classes)
    estimator = MotionClassifier(str(options.estimator), _weights(table, options), options.seed)
    estimator.fit(X, y, inner_groups(y, table.groups[rows]))
    return MemberFit(reader, values, X, estimator, 1.0)


class HeldOut(NamedTuple):
    """Answers of one fold to the cases that took no part in its fit.

    Parameters
    ----------
    probabilities : (cases, classes) float64
    distances : (cases,) float64
        From the nearest class.
    choices : tuple of (str, float)
        The choices of features that the fold made, in words, and their weights; these sum to 1.
    """

    probabilities: NDArray[np.float64]
    distances: NDArray[np.float64]
    choices: tuple[tuple[str, float], ...]


def predict_fold(
    table: CaseTable,
    inner: NDArray[np.int64],
    outer: NDArray[np.int64],
    options: TrainingOptions,
) -> HeldOut:
    """Fit to some cases and predict others."""
    fold = fit_rows(table, inner, options)
    readings, distances = fit_domain(table, inner).nearest(outer)
    probabilities = fold.probabilities(outer, readings, len(table.classes))
    return HeldOut(probabilities, distances, fold.choices)


def _case_weights(
    table: CaseTable, rows: NDArray[np.int64], options: TrainingOptions
) -> NDArray[np.float64] | None:
    """Weight of each case by its class; None where all count alike."""
    weights = _weights(table, options)
    if weights is None:
        return None
    y = table.y[rows]
    if isinstance(weights, Mapping):
        return np.array([weights.get(int(k), 1.0) for k in y])
    counts = np.bincount(y, minlength=len(table.classes))
    return np.asarray(1.0 / counts[y])


def _weights(table: CaseTable, options: TrainingOptions) -> Any:
    weights = options.class_weights
    if isinstance(weights, Mapping):
        return {table.classes.index(k): w for k, w in weights.items() if k in table.classes}
    return None if weights == ClassWeights.NONE else str(weights)
