"""What looks like a slip of the pen in a training set: labels, subjects and units."""

from __future__ import annotations

import difflib
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from modalmotion.classification.features import Further
from modalmotion.classification.training.case_row import CaseRow
from modalmotion.classification.training.cases import case_name
from modalmotion.numerals import counted

# A class of one case is called misspelt beside a class of as many.
_MANY: Final = 5

# Least likeness of the two names: "weka" and "weak" have 0.75.
_ALIKE: Final = 0.74

_TIMES_LARGER: Final = 30.0

# Share of subjects in several classes from which on their ids may be numbered by class.
_RESTARTED: Final = 0.5

# Cases that are named for one reason.
_MOST_NAMED: Final = 5

SUBJECT_NOTE: Final = (
    "No subject is stated, so each recording counted as a subject of its own. If some are of one "
    "person, state subjects: else the accuracy is too hopeful."
)


def cohort_notes(rows: Sequence[CaseRow]) -> tuple[str, ...]:
    """Name classes spelt alike, subjects unstated or in several classes, sizes far from others'.

    Parameters
    ----------
    rows : sequence of CaseRow
    """
    unstated = () if any(row.subject for row in rows) else (SUBJECT_NOTE,)
    return (*_spelling(rows), *unstated, *_restarted(rows), *_sizes(rows))


def _restarted(rows: Sequence[CaseRow]) -> Iterator[str]:
    """Note ids of subjects that most classes share: their numbering may begin anew in each."""
    classes: dict[str, set[str]] = {}
    for row in rows:
        if row.subject is not None:
            classes.setdefault(row.subject, set()).add(row.label)
    shared = [subject for subject, labels in classes.items() if len(labels) > 1]
    if len(shared) >= 2 and len(shared) >= _RESTARTED * len(classes):
        yield (
            f"{len(shared)} of {len(classes)} subjects have recordings of several classes, and "
            "count as one person each. If their numbering begins anew in each class, put the class "
            "before the number, such as 'normal 1': else persons that have nothing to do with one "
            "another are kept together."
        )


def _spelling(rows: Sequence[CaseRow]) -> Iterator[str]:
    counts = Counter(row.label for row in rows)
    by_rarity = sorted(counts, key=lambda label: (counts[label], label))
    for k, label in enumerate(by_rarity):
        others = by_rarity[k + 1 :]
        plain = _plain(label)
        twin = next((one for one in reversed(others) if _plain(one) == plain), None)
        cases = _named([_name(row) for row in rows if row.label == label])
        if twin is not None:
            what = "case" if label.split() != twin.split() else "blanks"
            yield (
                f"The class {label[:80]!r} differs from {twin[:80]!r} in {what} alone: case "
                f"{cases}. If they are one, spell them alike."
            )
            continue
        many = [one for one in others if counts[one] >= _MANY and _words(one) != _words(label)]
        close = difflib.get_close_matches(label, many, n=1, cutoff=_ALIKE)
        if counts[label] == 1 and close:
            yield (
                f"The class {label[:80]!r} has one case, {cases}, and is spelt nearly as "
                f"{close[0][:80]!r}. If it is a slip, correct it."
            )


def _plain(label: str) -> str:
    return " ".join(label.casefold().split())


def _words(label: str) -> str:
    """Give a name without its numbers: "grade 1" and "grade 2" are no misspelling."""
    return re.sub(r"\d+", "", label)


def _sizes(rows: Sequence[CaseRow]) -> Iterator[str]:
    sizes = np.array(
        [
            next(float(v[0]) for key, v in row.further.items() if key.kind == Further.SIZE)
            for row in rows
        ]
    )
    away = sizes - np.median(sizes)
    odd = np.flatnonzero(np.abs(away) > math.log(_TIMES_LARGER))
    for k in odd[:_MOST_NAMED]:
        times = float(f"{math.exp(min(away[k], 100.0)):.2g}")
        yield f"{_name(rows[k])} is {times:g} times as large as the others: check its unit."
    if len(odd) > _MOST_NAMED:
        more = counted(len(odd) - _MOST_NAMED, "further case")
        yield f"The size of {more} differs as much from the others': check units."


def _name(row: CaseRow) -> str:
    return row.name or case_name(row.sequence_id)


def _named(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (
        f" and {counted(more, 'other case')}" if more > 0 else ""
    )
