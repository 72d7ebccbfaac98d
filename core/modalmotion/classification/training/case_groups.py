"""Which cases must stay together when training cases are split."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.training.case_row import CaseRow
from modalmotion.classification.training.own_folds import values_of


def group_cases(
    rows: Sequence[CaseRow], by: str | None = None
) -> tuple[tuple[str, ...], NDArray[np.int64], int]:
    """Subjects, groups of cases that share a subject or recording, number of mixed recordings.

    Parameters
    ----------
    rows : sequence of CaseRow
    by : str, optional
        Covariate whose cases are together too, such as a site.

    Returns
    -------
    subjects : tuple of str
    groups : (cases,) int64
    n_mixed : int
        Recordings with two stated subjects.

    Raises
    ------
    ParameterError
        If no case has that covariate.
    """
    subjects = tuple(row.subject or f"sequence {row.sequence_id}" for row in rows)
    parent: dict[str, str] = {}

    def root(name: str) -> str:
        while parent.setdefault(name, name) != name:
            name = parent[name]
        return name

    seen: dict[str, set[str]] = {}
    for row, subject in zip(rows, subjects, strict=True):
        parent[root(subject)] = root(f"sequence {row.sequence_id}")
        if row.subject is not None:
            seen.setdefault(row.sequence_id, set()).add(subject)
    if by is not None:
        values = values_of(by, "groups", [row.covariates for row in rows])
        for value, subject in zip(values, subjects, strict=True):
            if value is not None:
                parent[root(f"\0group {value}")] = root(subject)
    roots = [root(subject) for subject in subjects]
    places = {name: k for k, name in enumerate(dict.fromkeys(roots))}
    mixed = sum(len(names) > 1 for names in seen.values())
    return subjects, np.array([places[name] for name in roots]), mixed


def inner_groups(y: NDArray[np.int64], groups: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give the groups for choosing settings among some cases.

    Leaving a group out says nothing of a class that is in no other: the cases of such a class
    are groups of their own.

    Parameters
    ----------
    y, groups : (cases,) int64

    Returns
    -------
    (cases,) int64
    """
    inner = groups.copy()
    for k in np.unique(y):
        mine = np.flatnonzero(y == k)
        if len(np.unique(groups[mine])) == 1:
            inner[mine] = groups.max() + 1 + mine
    return inner
