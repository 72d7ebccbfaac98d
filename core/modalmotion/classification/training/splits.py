"""Folds of the cross-validation. scikit-learn is imported here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.own_folds import fold_notes
from modalmotion.classification.training.table import CaseTable


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
        If the user's own folds cannot be used.
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
        folds = min(options.folds, min(subjects))
        split = StratifiedGroupKFold(folds, **shuffled).split(table.y, table.y, table.groups)
        return Splits(list(split), True, [])
    alone = table.classes[int(np.argmin(subjects))]
    note = (
        f"The class {alone!r} has one subject only: how well it is recognised in another "
        "subject cannot be known. "
    )
    if cases.min() < 2:
        return Splits(
            [], False, [note + "There was no cross-validation, so class sets hold everything."]
        )
    folds = min(options.folds, int(cases.min()))
    split = StratifiedKFold(folds, **shuffled).split(table.y, table.y)
    note += "Cross-validation split recordings of one subject, and is too hopeful."
    return Splits(list(split), False, [note])
