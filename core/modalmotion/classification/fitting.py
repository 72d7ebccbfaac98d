"""The fit to some cases of a cohort: tables of features, weighed by cases that are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.cohort import Cohort
from modalmotion.classification.extractor import (
    AXIS,
    SHAPE,
    SIZE,
    SUMMARY,
    TERMS,
    VOLUME,
    WAVES,
    Extractor,
    first,
    reads_about_axis,
    typical_motion,
)
from modalmotion.classification.linear import (
    Linear,
    discriminant,
    left_out_scores,
    log_losses,
    temperature_of,
)
from modalmotion.classification.options import MODE_COUNTS, Timing, TrainingOptions
from modalmotion.classification.waves import waves_of
from modalmotion.signature.value import whole_count

# A cycle whose next frame would be the first closes within this many usual steps.
_CLOSED: Final = 2.5

# Logs of the prior where a cavity is read: few hearts are told apart by the parts about the axis
# first, then by the volume. Of other surfaces all tables are as likely.
_PRIOR: Final = {AXIS: 0.0, "": -0.7, SUMMARY: -2.0, WAVES: -2.0, TERMS: -2.0}

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

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


class TableFit(NamedTuple):
    """One table, the score of its features, and its share in the whole."""

    extractor: Extractor
    X: Array
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
    losses: Array
    groups: Rows

    def scores(self, rows: Rows) -> Array:
        """Scores of some cases of the cohort, (cases, classes)."""
        parts = [table.linear.scores(table.X[rows]) for table in self.tables]
        return np.asarray(np.sum(parts, axis=0))

    @property
    def choices(self) -> tuple[tuple[str, float], ...]:
        """Tables in words, with their weights."""
        return tuple((table.extractor.description, table.weight) for table in self.tables)


class Tables:
    """Tables of features that may be weighed on a cohort, each read once.

    Parameters
    ----------
    cohort : Cohort
    options : TrainingOptions
    """

    def __init__(self, cohort: Cohort, options: TrainingOptions) -> None:
        self.cohort = cohort
        self._options = options
        self._read: dict[tuple[object, ...], Array] = {}

    @cached_property
    def of_motion(self) -> tuple[Extractor, ...]:
        """Tables of the motion, the simplest first."""
        cohort = self.cohort
        motions, walls = cohort.motions, cohort.walls
        modes, most = motions[0].modes, cohort.readable.n_modes
        gaps = [motion.signature.closure_gap for motion in motions]
        closes = float(np.median(gaps)) < _CLOSED
        timings = {Timing.CYCLE: (True,), Timing.TRANSIENT: (False,)}.get(
            Timing(self._options.timing), (True, False) if closes else (False,)
        )
        usual = {whole_count(modes, n) for n in MODE_COUNTS if n <= most}
        found = []
        for n in sorted({n for n in usual if n <= most} | {most}):
            waves = waves_of(first(modes, n), walls=walls)
            has_axis = all(reads_about_axis(motion, n) for motion in motions)
            for is_cycle in timings:
                kinds = [AXIS] if has_axis and is_cycle else []
                kinds += [SUMMARY, WAVES]
                # Terms as they are mean nothing where theta may start anywhere.
                if all(len(group) == 1 for group in waves.modes):
                    kinds.append(TERMS)
                found += [Extractor(kind, is_cycle, n, walls) for kind in kinds]
        return tuple(found)

    @cached_property
    def beside(self) -> tuple[Extractor, ...]:
        """Tables of what is beside the motion: of cavities alone their volume."""
        still = (SIZE, SHAPE)
        has_volume = all(motion.volumes is not None for motion in self.cohort.motions)
        sets = ((VOLUME,), (*still, VOLUME)) if has_volume else ((SIZE,), still)
        return tuple(replace(self.of_motion[0], what="", beside=beside) for beside in sets)

    def values(self, extractor: Extractor) -> Array:
        """Features of all cases, (cases, features)."""
        if extractor.learns:
            return np.stack([extractor.values(motion) for motion in self.cohort.motions])
        key = (extractor.what, extractor.is_cycle, extractor.n_modes, extractor.beside)
        if key not in self._read:
            values = [extractor.values(motion) for motion in self.cohort.motions]
            self._read[key] = np.stack(values)
        return self._read[key]

    def fitted(self, extractor: Extractor, rows: Rows) -> Extractor:
        """Give a table what it learns from some cases."""
        if not extractor.learns:
            return extractor
        terms = [extractor.terms(self.cohort.motions[k]) for k in rows.tolist()]
        return replace(extractor, typical=typical_motion(terms))


def fit_rows(tables: Tables, rows: Rows) -> Fit:
    """Fit to some cases with at most five tables, weighed by how well they predict cases left out.

    The motion is read in several tables, and what is beside it in others: evidence of both adds up.
    """
    cohort = tables.cohort
    compared = _some(cohort, rows)
    y, n_classes, groups = cohort.y[compared], len(cohort.classes), cohort.groups[compared]
    tried = [_Tried.of(tables, one, compared) for one in (*tables.of_motion, *tables.beside)]
    known = _weights(tried, groups)
    order = np.argsort(-known, kind="stable")[:_MOST_TABLES]
    order = order[known[order] >= min(_LEAST_WEIGHT, known[order[0]])]
    weights = known[order] / known[order].sum()
    scores = np.sum([w * tried[k].scores for w, k in zip(weights, order, strict=True)], axis=0)
    temperature = temperature_of(scores, y) if len(order) > 1 else 1.0
    found = []
    for weight, k in zip(weights.tolist(), order.tolist(), strict=True):
        one = tried[k]
        extractor, X = one.extractor, one.X
        if len(compared) < len(rows):
            extractor = tables.fitted(extractor, rows)
            X = tables.values(extractor)
        linear = discriminant(X[rows], cohort.y[rows], n_classes)
        factor = weight / (one.temperature * temperature)
        found.append(TableFit(extractor, X, linear.times(factor), weight))
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


class _Tried(NamedTuple):
    """A table on some cases: reliable scores of each, left out, and their losses."""

    extractor: Extractor
    X: Array
    scores: Array
    temperature: float
    losses: Array

    @classmethod
    def of(cls, tables: Tables, extractor: Extractor, rows: Rows) -> _Tried:
        cohort = tables.cohort
        extractor = tables.fitted(extractor, rows)
        X, y = tables.values(extractor), cohort.y[rows]
        scores = left_out_scores(X[rows], y, len(cohort.classes), cohort.groups[rows])
        temperature = temperature_of(scores, y)
        scores = scores / temperature
        return cls(extractor, X, scores, temperature, log_losses(scores, y))


def _some(cohort: Cohort, rows: Rows) -> Rows:
    """Take at most so many cases of each class."""
    parts = [rows[cohort.y[rows] == k] for k in np.unique(cohort.y[rows])]
    return np.sort(np.concatenate([mine[:: -(-len(mine) // _MOST_COMPARED)] for mine in parts]))


def _weights(tried: Sequence[_Tried], groups: Rows) -> Array:
    """Weigh tables by the losses of cases left out, (tables,) float64.

    Two whose losses differ by less than chance share their weight.

    Notes
    -----
    Pseudo-Bayesian model averaging with the Bayesian bootstrap: Yao, Vehtari, Simpson and Gelman,
    Using stacking to average Bayesian predictive distributions, Bayesian Analysis, 2018.
    """
    _, place, counts = np.unique(groups, return_inverse=True, return_counts=True)
    losses = np.zeros((len(tried), len(counts)))
    for k, one in enumerate(tried):
        np.add.at(losses[k], place, np.minimum(one.losses, 30.0))
    rng = np.random.default_rng(0)
    draws = rng.dirichlet(np.ones(len(counts)), _N_DRAWS) * len(counts)
    reads_cavity = any(VOLUME in one.extractor.beside for one in tried)
    prior = np.array([_PRIOR[one.extractor.what] * reads_cavity for one in tried])
    logs = prior - _POWER * draws @ losses.T
    shares = np.exp(logs - logs.max(axis=1, keepdims=True))
    return np.asarray((shares / shares.sum(axis=1, keepdims=True)).mean(axis=0))
