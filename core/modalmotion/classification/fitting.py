"""Fits to some cases of a cohort, weighed by cases left out, and the folds of cross-validation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from modalmotion.classification.cohort import Cohort
from modalmotion.classification.linear import (
    Linear,
    discriminant,
    left_out_scores,
    log_losses,
    temperature_of,
)
from modalmotion.classification.motion_features import (
    AXIS,
    SUMMARY,
    TERMS,
    VOLUME,
    WAVES,
    Extractor,
    kinds_of,
    timings_of,
)
from modalmotion.classification.options import MODE_COUNTS, TrainingOptions
from modalmotion.errors import ParameterError
from modalmotion.notes import Note
from modalmotion.representation import Floats, Ints, counted
from modalmotion.signature.value import whole_count

# Logs of the prior where a cavity is read: few hearts are distinguished by the parts about the
# axis first, then by the volume. Of other surfaces all tables are as likely.
_PRIOR: Final = {AXIS: 0.0, VOLUME: -0.7, SUMMARY: -2.0, WAVES: -2.0, TERMS: -2.0}

# Tables of a model, and the least weight of one.
_MOST_TABLES: Final = 5
_LEAST_WEIGHT: Final = 0.02

# Draws of the Bayesian bootstrap, and power of the likelihood: losses of cases left out from one
# another's fits are not independent, and of many tables one predicts a few cases well by luck.
_N_DRAWS: Final = 300
_POWER: Final = 0.25

# Cases of a class above which tables are compared on some of them: more cost time and say little.
_MOST_COMPARED: Final = 200

# Standard errors by which normal displacements must lower the loss of cases left out: they hold
# less, and what they gain by chance is lost on others.
_SURE: Final = 1.0


class Table(NamedTuple):
    """One table of the features of all cases, (cases, features)."""

    extractor: Extractor
    X: Floats


class TableFit(NamedTuple):
    """One table, the score of its features, and its share in the whole."""

    table: Table
    linear: Linear
    weight: float


@dataclass(frozen=True, eq=False)
class Fit:
    """Tables fitted to some cases; the sum of their scores gives log probabilities.

    Parameters
    ----------
    tables : tuple of TableFit
        The weightiest first; their weights add up to 1, and are in the scores.
    losses : (cases,) float64, nats
        Of the cases that were fitted to, each left out with its group.
    groups : (cases,) int64
    """

    tables: tuple[TableFit, ...]
    losses: Floats
    groups: Ints

    def scores(self, rows: Ints) -> Floats:
        """Scores of some cases of the cohort, (cases, classes)."""
        return np.asarray(sum(one.linear.scores(one.table.X[rows]) for one in self.tables))


def tables_of(cohort: Cohort, options: TrainingOptions) -> tuple[Table, ...]:
    """Read tables of the motion, the simplest first, then of cavities that of their volume."""
    motions, walls = cohort.motions, cohort.walls
    modes, most = motions[0].modes, cohort.readable.n_modes
    usual = {whole_count(modes, n) for n in MODE_COUNTS if n <= most}
    found = []
    for n in sorted({n for n in usual if n <= most} | {most}):
        for is_cycle in timings_of(motions, options.timing):
            kinds = kinds_of(motions, n, is_cycle=is_cycle, walls=walls)
            found += [Extractor(kind, is_cycle, n, walls) for kind in kinds]
    if all(motion.volumes is not None for motion in motions):
        found.append(replace(found[0], what=VOLUME))
    return tuple(Table(one, np.stack([one.values(motion) for motion in motions])) for one in found)


def fit_rows(cohort: Cohort, tables: Sequence[Table], rows: Ints) -> Fit:
    """Fit to some cases with at most five tables, weighed by how well they predict cases left out.

    The motion is read in several tables, and the volume in another: evidence of both adds up.
    """
    compared, n_classes = _some(cohort, rows), len(cohort.classes)
    y, groups = cohort.y[compared], cohort.groups[compared]
    left_out, temperatures = [], []
    for table in tables:
        scores = left_out_scores(table.X[compared], y, n_classes, groups)
        temperatures.append(temperature_of(scores, y))
        left_out.append(scores / temperatures[-1])
    losses = np.array([log_losses(scores, y) for scores in left_out])
    known = _weights([table.extractor.what for table in tables], losses, groups)
    order = np.argsort(-known, kind="stable")[:_MOST_TABLES]
    order = order[known[order] >= min(_LEAST_WEIGHT, known[order[0]])]
    weights = known[order] / known[order].sum()
    scores = np.asarray(sum(w * left_out[k] for w, k in zip(weights, order, strict=True)))
    temperature = temperature_of(scores, y) if len(order) > 1 else 1.0
    found = []
    for weight, k in zip(weights.tolist(), order.tolist(), strict=True):
        linear = discriminant(tables[k].X[rows], cohort.y[rows], n_classes)
        factor = weight / (temperatures[k] * temperature)
        found.append(TableFit(tables[k], linear.times(factor), weight))
    return Fit(tuple(found), log_losses(scores / temperature, y), groups)


def better(fits: Sequence[Fit]) -> int:
    """Place of the fit whose basis predicts cases left out better: the first, unless surely not."""
    best = 0
    for place, fit in enumerate(fits):
        _, group = np.unique(fit.groups, return_inverse=True)
        gains = np.bincount(group, fits[best].losses - fit.losses)
        if gains.sum() > _SURE * gains.std() * np.sqrt(len(gains)):
            best = place
    return best


def _some(cohort: Cohort, rows: Ints) -> Ints:
    """Take at most so many cases of each class."""
    parts = [rows[cohort.y[rows] == k] for k in np.unique(cohort.y[rows])]
    return np.sort(np.concatenate([mine[:: -(-len(mine) // _MOST_COMPARED)] for mine in parts]))


def _weights(kinds: Sequence[str], losses: Floats, groups: Ints) -> Floats:
    """Weigh tables by the losses of cases left out, (tables,) float64.

    Two whose losses differ by less than chance share their weight.

    Parameters
    ----------
    kinds : sequence of str
        What each reads.
    losses : (tables, cases) float64, nats
    groups : (cases,) int64

    Notes
    -----
    Pseudo-Bayesian model averaging with the Bayesian bootstrap: Yao, Vehtari, Simpson and Gelman,
    Using stacking to average Bayesian predictive distributions, Bayesian Analysis, 2018.
    """
    _, place, counts = np.unique(groups, return_inverse=True, return_counts=True)
    of_groups = np.array([np.bincount(place, np.minimum(own, 30.0)) for own in losses])
    rng = np.random.default_rng(0)
    draws = rng.dirichlet(np.ones(len(counts)), _N_DRAWS) * len(counts)
    prior = np.array([_PRIOR[kind] * (VOLUME in kinds) for kind in kinds])
    logs = prior - _POWER * draws @ of_groups.T
    shares = np.exp(logs - logs.max(axis=1, keepdims=True))
    return np.asarray((shares / shares.sum(axis=1, keepdims=True)).mean(axis=0))


Fold = tuple[Ints, Ints]
"""Cases to fit to and cases to predict."""

# Of groups of which each is held out by itself.
_MOST_GROUPS: Final = 20

Folds = Sequence[int] | Ints
"""For each case the number of the fold in which it is predicted."""


class Splits(NamedTuple):
    """How cases are split.

    Parameters
    ----------
    repetitions : list of list of ((n,) int64, (m,) int64)
        Folds of each; none where a class cannot be split.
    is_grouped : bool
        Whether subjects are kept together.
    notes : list of Note
    """

    repetitions: list[list[Fold]]
    is_grouped: bool
    notes: list[Note]


def split_cases(cohort: Cohort, options: TrainingOptions, cv: Folds | None = None) -> Splits:
    """Split the cases anew for each repetition, or once by the user's own folds.

    Raises
    ------
    ParameterError
        If the user's own folds cannot be used, or no folds by group leave two classes to fit to.
    """
    if cv is not None:
        return _own_folds(cv, cohort)
    drawn = [_drawn(cohort, options, number) for number in range(options.repetitions)]
    # Folds that the seed does not change say nothing new.
    repetitions = {_held_out(folds): folds for folds, _, _ in drawn if folds}
    return Splits(list(repetitions.values()), *drawn[0][1:])


def _drawn(
    cohort: Cohort, options: TrainingOptions, number: int
) -> tuple[list[Fold], bool, list[Note]]:
    from sklearn.model_selection import StratifiedGroupKFold, StratifiedKFold

    y, groups, n_classes = cohort.y, cohort.groups, len(cohort.classes)
    subjects = [len(np.unique(groups[y == k])) for k in range(n_classes)]
    cases = int(np.bincount(y, minlength=n_classes).min())
    shuffled = {"shuffle": True, "random_state": (options.seed + number) % 2**32}
    if min(subjects) >= 2:
        n_folds = min(options.folds, min(subjects))
        folds = list(StratifiedGroupKFold(n_folds, **shuffled).split(y, y, groups))
        if _least_classes(folds, y) < n_classes:
            folds = _better_folds(folds, cohort, options)
        return folds, True, []
    alone = cohort.classes[int(np.argmin(subjects))]
    what = "subject" if options.groups is None else f"value of {options.groups}"
    if cases < 2:
        folds, consequence = [], "There was no cross-validation, so class sets contain every class."
    else:
        folds = list(StratifiedKFold(min(options.folds, cases), **shuffled).split(y, y))
        consequence = (
            f"Cross-validation split recordings of the same {what}, so its figures are "
            "too optimistic."
        )
    note = Note.of("class_of_one", label=alone, what=what, consequence=consequence)
    return folds, False, [note]


def _least_classes(folds: Sequence[Fold], y: Ints) -> int:
    """Give the least number of classes that a fold has cases of to fit to."""
    return min(len(np.unique(y[inner])) for inner, _ in folds)


def _better_folds(folds: list[Fold], cohort: Cohort, options: TrainingOptions) -> list[Fold]:
    """Leave out one group at a time if several together contain all cases of a class."""
    names = np.unique(cohort.groups)
    if len(names) <= _MOST_GROUPS:
        alone = [
            (np.flatnonzero(cohort.groups != k), np.flatnonzero(cohort.groups == k)) for k in names
        ]
        if _least_classes(alone, cohort.y) > _least_classes(folds, cohort.y):
            folds = alone
    if _least_classes(folds, cohort.y) < 2:
        by = "subjects" if options.groups is None else f"the values of {options.groups!r}"
        raise ParameterError(
            f"The classes are confounded with {by}: if some are held out, only one class remains.",
            remedy="Omit the option 'groups' and read the confounds on the card, group by another "
            "column, or give folds with training cases of two classes (cv).",
            details={"option": "groups"},
        )
    return folds


def _held_out(folds: Sequence[Fold]) -> frozenset[tuple[int, ...]]:
    return frozenset(tuple(outer.tolist()) for _, outer in folds)


def _own_folds(cv: Folds, cohort: Cohort) -> Splits:
    """Take the user's own folds of the cases that count; those left out or repeated are missing."""
    numbers, n = np.asarray(cv), cohort.n_given
    if numbers.shape != (n,):
        raise ParameterError(
            f"'cv' has the shape {numbers.shape}, for {counted(n, 'case')}.",
            remedy="Give the number of the fold in which each case is predicted.",
        )
    own = numbers[cohort.numbers]
    folds = [(np.flatnonzero(own != k), np.flatnonzero(own == k)) for k in np.unique(own)]
    if len(folds) < 2 or _least_classes(folds, cohort.y) < 2:
        raise ParameterError(
            "In one fold of 'cv' fewer than two classes remain for training.",
            remedy="Spread the cases of each class over the folds.",
        )
    notes, groups = [Note.of("own_folds")], cohort.groups
    torn = {g for inner, outer in folds for g in np.intersect1d(groups[inner], groups[outer])}
    if torn:
        notes.append(Note.of("folds_torn", n_groups=len(torn)))
    for k, (inner, outer) in enumerate(folds):
        unseen = np.setdiff1d(cohort.y[outer], cohort.y[inner])
        if len(unseen):
            names = ", ".join(cohort.classes[c] for c in unseen)
            notes.append(Note.of("fold_without_class", fold=k + 1, classes=names))
    return Splits([folds], not torn, notes)
