"""Folds of the cross-validation: drawn by subject, or the user's own. Imports scikit-learn."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.cohort import Cohort
from modalmotion.classification.options import TrainingOptions
from modalmotion.errors import ParameterError

Fold = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Cases to fit to and cases to predict."""

# Of groups of which each is held out by itself.
_MOST_GROUPS: Final = 20

_HOW: Final = (
    "Give a splitter of scikit-learn that predicts each case once, such as StratifiedGroupKFold or "
    "LeaveOneGroupOut, or a list of pairs (cases to fit to, cases to predict) of indices from 0."
)


class Splitter(Protocol):
    """What scikit-learn calls a cross-validation generator."""

    def split(self, X: Any, y: Any, groups: Any) -> Iterable[tuple[Any, Any]]:
        """Give the indices of the cases to fit to and to predict, for each fold."""


Folds = Splitter | Iterable[tuple[Any, Any]]
"""Folds of the user's own."""


class Splits(NamedTuple):
    """How cases are split.

    Parameters
    ----------
    repetitions : list of list of ((n,) int64, (m,) int64)
        Folds of each; none where a class cannot be split.
    is_grouped : bool
        Whether subjects are kept together.
    notes : list of str
    """

    repetitions: list[list[Fold]]
    is_grouped: bool
    notes: list[str]


def split_cases(cohort: Cohort, options: TrainingOptions, cv: Folds | None = None) -> Splits:
    """Split the cases anew for each repetition, or once by the user's own folds.

    Raises
    ------
    ParameterError
        If the user's own folds cannot be used, or no folds by group leave two classes to fit to.
    """
    if cv is not None:
        own = _own_folds(cv, cohort)
        return Splits([own], not _n_torn(own, cohort), _notes_on_own(own, cohort))
    first, is_grouped, notes = _drawn(cohort, options, 0)
    repetitions = [first] if first else []
    for number in range(1, options.repetitions):
        again = _drawn(cohort, options, number)[0]
        # Folds that the seed does not change say nothing new.
        if not first or _held_out(again) == _held_out(first):
            break
        repetitions.append(again)
    return Splits(repetitions, is_grouped, notes)


def _drawn(
    cohort: Cohort, options: TrainingOptions, number: int
) -> tuple[list[Fold], bool, list[str]]:
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
    note = (
        f"The class {alone!r} has one {what} only: its recognition in another {what} was not "
        "tested. "
    )
    if cases < 2:
        note += "There was no cross-validation, so class sets contain every class."
        return [], False, [note]
    folds = list(StratifiedKFold(min(options.folds, cases), **shuffled).split(y, y))
    note += f"Cross-validation split recordings of one {what}, and is too optimistic."
    return folds, False, [note]


def _least_classes(folds: Sequence[Fold], y: NDArray[np.int64]) -> int:
    """Give the least number of classes that a fold has cases of to fit to."""
    return min(len(np.unique(y[inner])) for inner, _ in folds)


def _better_folds(folds: list[Fold], cohort: Cohort, options: TrainingOptions) -> list[Fold]:
    """Hold out one group after another where several together take all cases of a class."""
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
            f"The classes are confounded with {by}: with some held out, only one class remains.",
            remedy="Leave the option 'groups' out and read the confounds of the card, group by "
            "another column, or give folds that leave cases of two classes (cv).",
            details={"option": "groups"},
        )
    return folds


def _held_out(folds: Sequence[Fold]) -> set[tuple[int, ...]]:
    return {tuple(outer.tolist()) for _, outer in folds}


def _own_folds(cv: Folds, cohort: Cohort) -> list[Fold]:
    """Take the user's own folds of the cases that count."""
    numbers, pairs = cohort.numbers, cv
    split = getattr(cv, "split", None)
    labels = [cohort.classes[k] for k in cohort.y]
    try:
        with warnings.catch_warnings():
            # A splitter that does not look at groups says so.
            warnings.simplefilter("ignore", UserWarning)
            if split is not None:
                pairs = split(np.arange(len(numbers))[:, None], np.array(labels), cohort.groups)
            found = [(_indices(inner), _indices(outer)) for inner, outer in pairs]  # type: ignore[union-attr]
    except (TypeError, ValueError) as error:
        raise ParameterError(f"'cv' gives no folds: {error}", remedy=_HOW) from error
    if split is None:
        rows = {number: row for row, number in enumerate(numbers.tolist())}
        for k, pair in enumerate(found):
            for index in np.concatenate(pair).tolist():
                if not 0 <= index < cohort.n_given:
                    raise ParameterError(
                        f"Fold {k + 1} of 'cv' names the case {index}, but cases are numbered 0 "
                        f"to {cohort.n_given - 1}.",
                        remedy=_HOW,
                        details={"fold": k + 1, "case": index},
                    )
        # Cases that came twice or were left out are missing.
        found = [
            (
                np.array([rows[i] for i in inner.tolist() if i in rows], dtype=np.int64),
                np.array([rows[i] for i in outer.tolist() if i in rows], dtype=np.int64),
            )
            for inner, outer in found
        ]
    folds = [(inner, outer) for inner, outer in found if len(outer)]
    _require_partition(folds, cohort)
    return folds


def _indices(part: Any) -> NDArray[np.int64]:
    indices = np.asarray(part)
    if indices.ndim != 1 or (len(indices) and indices.dtype.kind not in "iu"):
        raise TypeError(f"{str(part)[:40]} are not indices of cases")
    return indices.astype(np.int64)


def _require_partition(folds: Sequence[Fold], cohort: Cohort) -> None:
    counts = np.zeros(len(cohort), dtype=np.int64)
    for k, (inner, outer) in enumerate(folds):
        np.add.at(counts, outer, 1)
        both = np.intersect1d(inner, outer)
        n_seen = len(np.unique(cohort.y[inner]))
        fault = ""
        if len(both):
            fault = f"both fits to and predicts the case {cohort.numbers[both[0]]}"
        elif n_seen < 2:
            fault = f"leaves {n_seen} class(es) to fit to"
        if fault:
            raise ParameterError(f"Fold {k + 1} of 'cv' {fault}.", remedy=_HOW)
    wrong = np.flatnonzero(counts != 1)
    if len(wrong):
        case = cohort.numbers[wrong[0]]
        raise ParameterError(
            f"The folds of 'cv' predict the case {case} {counts[wrong[0]]} times.",
            remedy=_HOW,
            details={"case": int(case)},
        )


def _n_torn(folds: Sequence[Fold], cohort: Cohort) -> int:
    """Count the groups on both sides of a split."""
    groups = cohort.groups
    return len({g for inner, outer in folds for g in np.intersect1d(groups[inner], groups[outer])})


def _notes_on_own(folds: Sequence[Fold], cohort: Cohort) -> list[str]:
    notes, n_torn = ["The folds are the user's own."], _n_torn(folds, cohort)
    if n_torn:
        notes.append(
            f"Subjects or groups on both sides of a split: {n_torn}. Cross-validation is too "
            "optimistic."
        )
    for k, (inner, outer) in enumerate(folds):
        unseen = np.setdiff1d(cohort.y[outer], cohort.y[inner])
        if len(unseen):
            names = ", ".join(cohort.classes[c] for c in unseen)
            notes.append(f"Fold {k + 1} had no case of {names} to fit to.")
    return notes
