"""Folds of the user's own: a splitter of scikit-learn, pairs of indices, or a column."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError

Fold = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Cases to fit to and cases to predict."""

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


def folds_of(
    cv: Folds,
    numbers: NDArray[np.int64],
    n_given: int,
    labels: Sequence[str],
    groups: NDArray[np.int64],
) -> tuple[Fold, ...]:
    """Take the user's own folds of the cases that count.

    Parameters
    ----------
    cv : splitter or iterable of (indices, indices)
        Indices are numbers of the cases as they were given.
    numbers : (cases,) int64
        Of the cases that count: one that came twice or was left out is missing.
    n_given : int
        Number of cases as they were given.
    labels : sequence of str
    groups : (cases,) int64

    Raises
    ------
    ParameterError
        If they are no folds, or do not predict each case once.
    """
    pairs: Any = cv
    split = getattr(cv, "split", None)
    try:
        with warnings.catch_warnings():
            # A splitter that does not look at groups says so.
            warnings.simplefilter("ignore", UserWarning)
            if split is not None:
                pairs = split(np.arange(len(numbers))[:, None], np.array(labels), groups)
            pairs = [(_indices(inner), _indices(outer)) for inner, outer in pairs]
    except (TypeError, ValueError) as error:
        raise ParameterError(f"'cv' gives no folds: {error}", remedy=_HOW) from error
    if split is None:
        rows = {number: row for row, number in enumerate(numbers.tolist())}
        for k, pair in enumerate(pairs):
            for index in np.concatenate(pair).tolist():
                if not 0 <= index < n_given:
                    raise ParameterError(
                        f"Fold {k + 1} of 'cv' names the case {index}, but cases are numbered 0 "
                        f"to {n_given - 1}.",
                        remedy=_HOW,
                        details={"fold": k + 1, "case": index},
                    )
        pairs = [tuple(_kept(part, rows) for part in pair) for pair in pairs]
    folds = tuple((inner, outer) for inner, outer in pairs if len(outer))
    _require_partition(folds, numbers, "'cv'")
    return folds


def folds_by(
    column: str,
    covariates: Sequence[Mapping[str, float | str]],
    numbers: Sequence[int],
) -> tuple[Fold, ...]:
    """Take the folds that a covariate names: each of its values is predicted by the others.

    Raises
    ------
    ParameterError
        If it is not known of every case, or has one value only.
    """
    values = values_of(column, "fold", covariates)
    missing = [number for number, value in zip(numbers, values, strict=True) if value is None]
    names = sorted({value for value in values if value is not None})
    if missing or len(names) < 2:
        what = f"is unknown of the case {missing[0]}" if missing else f"is {names[0]} in every case"
        raise ParameterError(
            f"The option 'fold' names {column!r}, which {what}.",
            remedy="Name a column that puts every case into one of at least two folds.",
            details={"option": "fold"},
        )
    which = np.array([names.index(str(value)) for value in values])
    return tuple(
        (np.flatnonzero(which != k), np.flatnonzero(which == k)) for k in range(len(names))
    )


def values_of(
    column: str, option: str, covariates: Sequence[Mapping[str, float | str]]
) -> list[str | None]:
    """Give a covariate's value of each case as text, None where it is unknown.

    Parameters
    ----------
    column : str
        Capitals do not matter.
    option : str
        That names it, for the error.
    covariates : sequence of mapping

    Raises
    ------
    ParameterError
        If it is known of no case; it names those that there are.
    """
    known = {name.casefold(): name for case in covariates for name in case}
    if column.casefold() not in known:
        names = ", ".join(sorted(set(known.values()))) or "there is none"
        raise ParameterError(
            f"The option {option!r} names the covariate {column[:80]!r}, which no case has.",
            remedy=f"Use a column of the manifest or a covariate of the cases: {names}.",
            details={"option": option, "covariates": sorted(set(known.values()))},
        )
    folded = [{name.casefold(): value for name, value in case.items()} for case in covariates]
    values = [case.get(column.casefold()) for case in folded]
    return [None if value is None else str(value) for value in values]


def fold_notes(
    folds: Sequence[Fold], y: NDArray[np.int64], groups: NDArray[np.int64], classes: Sequence[str]
) -> tuple[bool, list[str]]:
    """Tell whether folds keep groups together, and what else a reader of the card should know.

    Raises
    ------
    ParameterError
        If a fold leaves one class to fit to.
    """
    n_torn = len(
        {g for inner, outer in folds for g in np.intersect1d(groups[inner], groups[outer])}
    )
    notes = ["The folds are the user's own."]
    if n_torn:
        notes.append(
            f"Subjects or groups on both sides of a split: {n_torn}. Cross-validation is too "
            "hopeful."
        )
    for k, (inner, outer) in enumerate(folds):
        seen = np.unique(y[inner])
        if len(seen) < 2:
            raise ParameterError(
                f"Fold {k + 1} leaves {len(seen)} class(es) to fit to.",
                remedy="Give folds that leave cases of two classes or more.",
                details={"fold": k + 1},
            )
        unseen = [classes[c] for c in np.setdiff1d(y[outer], seen)]
        if unseen:
            notes.append(f"Fold {k + 1} had no case of {', '.join(unseen)} to fit to.")
    return not n_torn, notes


def _indices(part: Any) -> NDArray[np.int64]:
    indices = np.asarray(part)
    if indices.ndim != 1 or (len(indices) and indices.dtype.kind not in "iu"):
        raise TypeError(f"{str(part)[:40]} are not indices of cases")
    return indices.astype(np.int64)


def _kept(part: NDArray[np.int64], rows: Mapping[int, int]) -> NDArray[np.int64]:
    return np.array([rows[i] for i in part.tolist() if i in rows], dtype=np.int64)


def _require_partition(folds: Sequence[Fold], numbers: NDArray[np.int64], which: str) -> None:
    counts = np.zeros(len(numbers), dtype=np.int64)
    for k, (inner, outer) in enumerate(folds):
        np.add.at(counts, outer, 1)
        both = np.intersect1d(inner, outer)
        if len(both):
            raise ParameterError(
                f"Fold {k + 1} of {which} both fits to and predicts the case {numbers[both[0]]}.",
                remedy=_HOW,
                details={"fold": k + 1, "case": int(numbers[both[0]])},
            )
    wrong = np.flatnonzero(counts != 1)
    if len(wrong):
        raise ParameterError(
            f"The folds of {which} predict the case {numbers[wrong[0]]} {counts[wrong[0]]} times.",
            remedy=_HOW,
            details={"case": int(numbers[wrong[0]])},
        )
