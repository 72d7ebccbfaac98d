"""The fit to some cases of a table: several choices of features, weighed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.choice_weights import choice_weights
from modalmotion.classification.estimators.scorer import pooled
from modalmotion.classification.estimators.temperature import (
    case_losses,
    fit_temperature,
    softmax,
)
from modalmotion.classification.features import FeatureReader, Further
from modalmotion.classification.model.domain import Judgement
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

# Standard errors by which others must lower the loss of cases left out.
_SURE: Final = 2.0

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
class Losses:
    """How badly cases were predicted that were left out.

    Parameters
    ----------
    of_cases : (cases,) float64, nats
        NaN where none could be left out.
    groups : (cases,) int64
        Cases of one group count as one.
    """

    of_cases: NDArray[np.float64]
    groups: NDArray[np.int64]

    @property
    def mean(self) -> float:
        """Of all cases, nats."""
        return float(self.of_cases.mean())

    def surely_above(self, others: Losses, n_errors: float) -> bool:
        """Whether those of the same cases are lower by more than some standard errors."""
        _, place = np.unique(self.groups, return_inverse=True)
        gains = np.zeros(int(place.max()) + 1)
        np.add.at(gains, place, self.of_cases - others.of_cases)
        return bool(gains.sum() > n_errors * gains.std() * np.sqrt(len(gains)))


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
    losses : Losses
        Of the cases that were left out.
    """

    members: tuple[MemberFit, ...]
    temperature: float
    classes: NDArray[np.int64]
    losses: Losses

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
    `choice_weights`. The volume stands among those of the motion from few cases on. Size, rest
    shape, volume curve and covariates are added to the weightiest choices where each class has
    several subjects, and kept where cases left out surely gain.
    """
    compared = _compared(table, rows, options.seed)
    quick = options
    if len(compared) > _MOST_COMPARED_FULLY and options.estimator == Estimator.AUTO:
        quick = replace(options, estimator=Estimator.LINEAR)
    fits = [_fit(table, choice, compared, quick) for choice in table.readers]
    if np.isnan(fits[0].estimator.held_out_).any():
        # Nothing says which is better.
        only = fits[0] if len(compared) == len(rows) else _fit(table, fits[0].reader, rows, options)
        unknown = Losses(fits[0].estimator.losses_, table.groups[compared])
        return FoldFit((replace(only, weight=1.0),), 1.0, only.estimator.classes_, unknown)
    kinds = _kinds(table, compared, options)
    if Further.VOLUME in kinds:
        volume = replace(_beside_motion(table), further=(Further.VOLUME,))
        fits.append(_fit(table, volume, compared, quick))
    pool = _pool(table, fits, compared, options)
    if _has_subjects(table, compared):
        more = [_fit(table, one, compared, quick) for one in _further(table, pool, kinds)]
        larger = _pool(table, [*fits, *more], compared, options)
        if pool.losses.surely_above(larger.losses, _SURE):
            pool = larger
    kept, losses = list(pool.members), pool.losses
    if len(compared) < len(rows) or quick is not options:
        kept = [replace(_fit(table, fit.reader, rows, options), weight=fit.weight) for fit in kept]
        pool = _pool(table, kept, rows, options, [fit.weight for fit in kept])
    return FoldFit(pool.members, pool.temperature, pool.members[0].estimator.classes_, losses)


@dataclass(frozen=True, eq=False)
class _Pool:
    """Members that are kept, their temperature, and the losses of cases left out."""

    members: tuple[MemberFit, ...]
    temperature: float
    losses: Losses


def _pool(
    table: CaseTable,
    fits: list[MemberFit],
    rows: NDArray[np.int64],
    options: TrainingOptions,
    weights: list[float] | None = None,
) -> _Pool:
    """Weigh choices, or take them by weights that are known."""
    known = np.array(_weights_of(table, fits, rows, options.seed) if weights is None else weights)
    order = [k for k in np.argsort(-known, kind="stable") if known[k] >= _LEAST_WEIGHT]
    shares = (known[order] / known[order].sum()).tolist()
    members = tuple(replace(fits[k], weight=w) for k, w in zip(order, shares, strict=True))
    classes = members[0].estimator.classes_
    y = np.searchsorted(classes, table.y[rows])
    held_out = pooled([m.estimator.held_out_ for m in members], shares)
    temperature = 1.0
    # The probabilities of one alone are reliable already.
    if len(members) > 1:
        temperature = fit_temperature(held_out, y, _class_weights(table, classes, y, options)[y])
    losses = Losses(case_losses(held_out / temperature, y), table.groups[rows])
    return _Pool(members, temperature, losses)


def _kinds(
    table: CaseTable, rows: NDArray[np.int64], options: TrainingOptions
) -> tuple[Further, ...]:
    """Kinds of features beside the motion that the cases have."""
    if not options.further:
        return ()
    covariates = [table.covariates[i] for i in rows]
    n_topologies = len(table.readable.topologies)
    return further_kinds(table.rows, covariates, _beside_motion(table), n_topologies)


def _beside_motion(table: CaseTable) -> FeatureReader:
    """Reader of what is beside the motion alone."""
    return replace(table.readers[0], typical=None, reads_motion=False)


def _has_subjects(table: CaseTable, rows: NDArray[np.int64]) -> bool:
    """Whether each class has several subjects."""
    y, groups = table.y[rows], table.groups[rows]
    return min(len(np.unique(groups[y == k])) for k in np.unique(y)) >= _FEWEST_SUBJECTS


def _further(table: CaseTable, pool: _Pool, kinds: tuple[Further, ...]) -> list[FeatureReader]:
    """List choices that read more than the motion, or other than it."""
    sets = _beside(kinds)
    best = [m.reader for m in pool.members if m.reader.reads_motion][:_N_EXTENDED]
    choices = [replace(base, further=beside) for base in best for beside in sets]
    apart = _beside_motion(table)
    if best:
        apart = replace(apart, n_modes=best[0].n_modes)
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
    reader = table.fitted(choice, rows, options.pose, options.seed)
    values = table.features(reader)
    X = best_readings(values[rows], y, n_classes, table.allowed[rows])
    kind = str(options.estimator)
    if kind == Estimator.AUTO and not reader.reads_motion and reader.further == (Further.VOLUME,):
        # Two numbers, from few cases on: a width chosen on these costs more than it finds.
        kind = Estimator.LINEAR
    classes, place = np.unique(y, return_inverse=True)
    _, groups = np.unique(inner_groups(y, table.groups[rows]), return_inverse=True)
    estimator = MotionClassifier(str(kind), random_state=options.seed)
    estimator.fit_places(X, classes, place, _class_weights(table, classes, place, options), groups)
    return MemberFit(reader, values, X, estimator, 1.0)


class HeldOut(NamedTuple):
    """Answers of one fold to the cases that took no part in its fit.

    Parameters
    ----------
    probabilities : (cases, classes) float64
    judgement : Judgement
        Of the fold's domain.
    choices : tuple of (str, float)
        The choices of features that the fold made, in words, and their weights; these sum to 1.
    losses : Losses
        See `FoldFit`.
    """

    probabilities: NDArray[np.float64]
    judgement: Judgement
    choices: tuple[tuple[str, float], ...]
    losses: Losses


def predict_fold(
    table: CaseTable,
    inner: NDArray[np.int64],
    outer: NDArray[np.int64],
    options: TrainingOptions,
) -> HeldOut:
    """Fit to some cases and predict others."""
    fold = fit_rows(table, inner, options)
    judgement = fit_domain(table, inner).judge(outer)
    probabilities = fold.probabilities(outer, judgement.readings, len(table.classes))
    return HeldOut(probabilities, judgement, fold.choices, fold.losses)


def _class_weights(
    table: CaseTable,
    classes: NDArray[np.int64],
    place: NDArray[np.int64],
    options: TrainingOptions,
) -> NDArray[np.float64]:
    """Weight of each class, (classes,), of cases whose classes have these places."""
    weights = options.class_weights
    if isinstance(weights, Mapping):
        return np.array([weights.get(table.classes[k], 1.0) for k in classes])
    if weights == ClassWeights.NONE:
        return np.ones(len(classes))
    return np.asarray(len(place) / (len(classes) * np.bincount(place)))
