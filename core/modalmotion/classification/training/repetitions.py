"""Which fits the cross-validation and the learning curve consist of."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.options import CardKind, TrainingOptions
from modalmotion.classification.training.splits import Splits, split_cases
from modalmotion.classification.training.table import CaseTable

# Cases of each class that the learning curve is measured at, where there are more.
_SIZES: Final = (4, 8, 16, 32, 64)

# Repetitions that the curve is drawn from.
_MOST_DRAWS: Final = 2


class PlannedFold(NamedTuple):
    """A fit to some cases, and others to be predicted by it.

    Parameters
    ----------
    repetition, fold : int
        From 0.
    size : int or None
        Most cases of each class, for the learning curve; None for all.
    inner, outer : (n,), (m,) int64
    """

    repetition: int
    fold: int
    size: int | None
    inner: NDArray[np.int64]
    outer: NDArray[np.int64]


class Plan(NamedTuple):
    """The folds of all repetitions; none where a class cannot be split.

    Parameters
    ----------
    splits : Splits
        Of the first repetition.
    folds : list of PlannedFold
        The first repetition first.
    curve : list of PlannedFold
    """

    splits: Splits
    folds: list[PlannedFold]
    curve: list[PlannedFold]

    @property
    def n_repetitions(self) -> int:
        """Number of repetitions."""
        return 1 + max((fold.repetition for fold in self.folds), default=-1)

    def describe(self, fold: PlannedFold) -> str:
        """Say in a few words which fit this is."""
        if fold.size is not None:
            return f"learning curve, {fold.size} a class"
        text = f"fold {fold.fold + 1} of {len(self.splits.folds)}"
        if self.n_repetitions > 1:
            text += f", repetition {fold.repetition + 1} of {self.n_repetitions}"
        return text


def plan_folds(table: CaseTable, options: TrainingOptions) -> Plan:
    """Split the cases anew for each repetition, and draw fewer cases for the learning curve."""
    first = split_cases(table, options)
    repetitions = [first.folds]
    for r in range(1, options.repetitions):
        again = split_cases(table, replace(options, seed=(options.seed + r) % 2**32)).folds
        # Folds that the seed does not change say nothing new.
        if _are_equal(again, first.folds):
            break
        repetitions.append(again)
    folds = [
        PlannedFold(r, k, None, inner, outer)
        for r, split in enumerate(repetitions)
        for k, (inner, outer) in enumerate(split)
    ]
    curve: list[PlannedFold] = []
    if options.card == CardKind.FULL:
        drawn = [fold for fold in folds if fold.repetition < _MOST_DRAWS]
        most = max((_most_of_a_class(table.y[fold.inner]) for fold in drawn), default=0)
        curve = [
            fold._replace(size=size, inner=_drawn(table.y, fold, size, options.seed))
            for size in _SIZES
            if size < most
            for fold in drawn
        ]
    return Plan(first, folds, curve)


def _drawn(y: NDArray[np.int64], fold: PlannedFold, size: int, seed: int) -> NDArray[np.int64]:
    """Take some cases of each class; a smaller draw is part of a larger one."""
    rng = np.random.default_rng([seed, fold.repetition, fold.fold])
    shuffled = rng.permutation(fold.inner)
    classes = np.unique(y[shuffled])
    return np.sort(np.concatenate([shuffled[y[shuffled] == k][:size] for k in classes]))


def _most_of_a_class(y: NDArray[np.int64]) -> int:
    return int(np.bincount(y).max())


_Folds = list[tuple[NDArray[np.int64], NDArray[np.int64]]]


def _are_equal(folds: _Folds, others: _Folds) -> bool:
    held_out = [{tuple(outer.tolist()) for _, outer in split} for split in (folds, others)]
    return held_out[0] == held_out[1]
