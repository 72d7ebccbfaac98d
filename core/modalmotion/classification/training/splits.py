"""Folds of the cross-validation. scikit-learn is imported here."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.own_folds import Fold, fold_notes
from modalmotion.classification.training.table import CaseTable
from modalmotion.errors import ParameterError

# Of groups of which each is held out by itself.
_MOST_GROUPS: Final = 20


class Splits(NamedTuple):
    """How cases are split.

    Parameters
    ----------
    folds : list of ((n,) int64, (m,) int64)
        Cases to fit to and cases to predict; none where a class cannot be split.
    is_grouped : bool
        Whether subjects are kept together.
    notes : list of str
        Caveats.
    """

    folds: list[tuple[NDArray[np.int64], NDArray[np.int64]]]
    is_grouped: bool
    notes: list[str]


def split_cases(table: CaseTable, options: TrainingOptions) -> Splits:
    """Split the cases by the user's own folds; else by subject, classes spread evenly.

    Raises
    ------
    ParameterError
        If the user's own folds cannot be used, or no folds by group leave all classes.
    """
    from sklearn.model_selection import StratifiedGroupKFold, StratifiedKFold

    own = table.own_folds
    if own:
        is_grouped, notes = fold_notes(own, table.y, table.groups, table.classes)
        return Splits(list(own), is_grouped, notes)

    n_classes = len(table.classes)
    subjects = [len(np.unique(table.groups[table.y == k])) for k in range(n_classes)]
    cases = np.bincount(table.y, minlength=n_classes)
    shuffled = {"shuffle": True, "random_state": options.seed}
    if min(subjects) >= 2:
        n_folds = min(options.folds, min(subjects))
        split = StratifiedGroupKFold(n_folds, **shuffled).split(table.y, table.y, table.groups)
        folds = list(split)
        if _least_classes(folds, table) < n_classes:
            folds = _better_folds(folds, table, options)
        return Splits(folds, True, [])
    alone = table.classes[int(np.argmin(subjects))]
    what = "subject" if options.groups is None else f"value of {options.groups}"
    note = (
        f"The class {alone!r} has one {what} only: how well it is recognised in another "
        f"{what} cannot be known. "
    )
    if cases.min() < 2:
        return Splits(
            [], False, [note + "There was no cross-validation, so class sets hold everything."]
        )
    n_folds = min(options.folds, int(cases.min()))
    split = StratifiedKFold(n_folds, **shuffled).split(table.y, table.y)
    note += f"Cross-validation split recordings of one {what}, and is too hopeful."
    return Splits(list(split), False, [note])


def _least_classes(folds: list[Fold], table: CaseTable) -> int:
    """Give the least number of classes that a fold has cases of to fit to."""
    return min(len(np.unique(table.y[inner])) for inner, _ in folds)


def _better_folds(folds: list[Fold], table: CaseTable, options: TrainingOptions) -> list[Fold]:
    """Hold out one group after another where several together take all cases of a class.

    Raises
    ------
    ParameterError
        If that leaves one class to fit to, too.
    """
    names = np.unique(table.groups)
    if len(names) <= _MOST_GROUPS:
        alone = [
            (np.flatnonzero(table.groups != k), np.flatnonzero(table.groups == k)) for k in names
        ]
        if _least_classes(alone, table) > _least_classes(folds, table):
            folds = alone
    if _least_classes(folds, table) < 2:
        by = "subjects" if options.groups is None else f"the values of {options.groups!r}"
        raise ParameterError(
            f"The classes go with {by}: where some are held out one class is left, and there is "
            "nothing to tell it from.",
            remedy="Leave the option 'groups' out and read the confounds of the card, group by "
            "another column, or give folds that leave cases of two classes (fold, cv).",
            details={"option": "groups"},
        )
    return folds
