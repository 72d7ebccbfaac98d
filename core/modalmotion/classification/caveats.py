"""What to heed of a cohort: slips of the pen, and conditions that separate the classes."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any, Final

import numpy as np

from modalmotion.classification.cases import TrainingCase, case_name
from modalmotion.notes import Note
from modalmotion.representation import Ints, counted

_TIMES_LARGER: Final = 30.0

# Cases that are named for one reason.
_MOST_NAMED: Final = 5


# Groups that the values of a number are put into, of about equal count.
_N_GROUPS: Final = 5

_N_PERMUTATIONS: Final = 1999

# More cases cost time and leave no doubt.
_MOST_CASES: Final = 2000

_SURE: Final = 0.05

Confound = dict[str, Any]
"""name, share (mean probability of the true class by this condition alone), chance (its mean where
classes are exchanged), p, p_holm, n_known, text."""


def cohort_notes(rows: Sequence[TrainingCase], sizes: Sequence[float]) -> tuple[Note, ...]:
    """Name classes spelt alike, subjects unstated, and sizes far from others'.

    Parameters
    ----------
    rows : sequence of TrainingCase
    sizes : sequence of float
        Logs of the sizes of their surfaces.
    """
    unstated = () if any(row.subject for row in rows) else (Note.of("subjects_unknown"),)
    return (*_spelling(rows), *unstated, *_sizes(rows, sizes))


def _spelling(rows: Sequence[TrainingCase]) -> Iterator[Note]:
    spelt: dict[str, list[str]] = {}
    for label, _ in Counter(row.label for row in rows).most_common():
        spelt.setdefault(" ".join(label.casefold().split()), []).append(label)
    for usual, *others in spelt.values():
        for label in others:
            cases = _named([_name(row) for row in rows if row.label == label])
            yield (Note.of("class_spelling", label=label[:80], usual=usual[:80], cases=cases))


def _sizes(rows: Sequence[TrainingCase], sizes: Sequence[float]) -> Iterator[Note]:
    away = np.array(sizes) - np.median(sizes)
    odd = np.flatnonzero(np.abs(away) > math.log(_TIMES_LARGER))
    for k in odd[:_MOST_NAMED]:
        times = float(f"{math.exp(min(away[k], 100.0)):.2g}")
        yield Note.of("size_unlike", case=_name(rows[k]), times=times)
    if len(odd) > _MOST_NAMED:
        more = counted(len(odd) - _MOST_NAMED, "further case")
        yield Note.of("sizes_unlike", cases=more)


def _name(row: TrainingCase) -> str:
    return row.name or case_name(row.sequence_id)


def _named(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (
        f" and {counted(more, 'other case')}" if more > 0 else ""
    )


def confounds(
    conditions: Sequence[Mapping[str, float | str]], y: Ints, groups: Ints, seed: int
) -> tuple[Confound, ...]:
    """Test how well each condition alone separates the classes.

    Parameters
    ----------
    conditions : sequence of mapping
        Of each case, what is known of its recording.
    y, groups : (cases,) int64
        Classes, and subjects: what is exchanged are the classes of whole subjects, and those
        within a subject who has several.
    seed : int

    Returns
    -------
    tuple of Confound
        The least probable by chance first. Conditions that are alike in all cases are left out.

    Notes
    -----
    The statistic is the mean over cases of the share that their class has among the cases of the
    same value, or the same fifth of the values; "unknown" is a value too. Permutation test,
    corrected by Holm, A simple sequentially rejective multiple test procedure, Scand J Stat, 1979.
    """
    names = list(dict.fromkeys(name for case in conditions for name in case))
    rng = np.random.default_rng(seed)
    some = np.sort(rng.permutation(len(y))[:_MOST_CASES])
    n_classes = int(y.max()) + 1
    exchanged = _exchanged(y[some], groups[some], rng)
    tested: list[Confound] = []
    for name in names:
        values = [conditions[i].get(name) for i in some]
        place = _parts_of(values)
        n_values = int(place.max()) + 1
        if n_values < 2:
            continue
        cells = place * n_classes + np.vstack([y[some][None], exchanged])
        counts = np.stack([np.bincount(row, minlength=n_values * n_classes) for row in cells])
        tables = counts.reshape(-1, n_values, n_classes).astype(np.float64)
        squares = (tables**2).sum(axis=2) / tables.sum(axis=2)
        shares = squares.sum(axis=1) / len(some)
        tested.append(
            {
                "name": name,
                "share": float(shares[0]),
                "chance": float(shares[1:].mean()),
                "p": float((shares >= shares[0] - 1e-12).mean()),
                "n_known": sum(value is not None for value in values),
            }
        )
    tested.sort(key=itemgetter("p"))
    largest = 0.0
    for rank, test in enumerate(tested):
        largest = max(largest, min(1.0, (len(tested) - rank) * test["p"]))
        test["p_holm"] = largest
        test["text"] = _in_words(test)
    return tuple(tested)


def confound_notes(tests: Sequence[Confound]) -> tuple[Note, ...]:
    """Warn of the conditions that surely separate the classes."""
    return tuple(
        Note.of("confound", finding=test["text"]) for test in tests if test["p_holm"] < _SURE
    )


def _in_words(test: Confound) -> str:
    how = "separates" if test["p_holm"] < _SURE else "does not surely separate"
    gain = 100.0 * (test["share"] - test["chance"])
    return (
        f"'{test['name']}' alone {how} the classes (given it, the true class has a mean "
        f"probability of {test['share']:.1%}, {abs(gain):.2g} points "
        f"{'more' if gain >= 0.0 else 'less'} than by chance; permutation test, p = "
        f"{test['p_holm']:.3f} after Holm)."
    )


def _parts_of(values: Sequence[float | str | None]) -> Ints:
    """Give each value a number from 0; many different numbers share one by fifths."""
    numbers = [v for v in values if isinstance(v, int | float)]
    is_number = len(numbers) == sum(value is not None for value in values)
    if is_number and len(set(numbers)) > _N_GROUPS:
        edges = np.unique(np.quantile(numbers, np.linspace(0, 1, _N_GROUPS + 1)[1:-1]))
        keys = ["" if v is None else str(np.searchsorted(edges, float(v))) for v in values]
    else:
        keys = ["" if v is None else f"={v}" for v in values]
    return np.asarray(np.unique(keys, return_inverse=True)[1])


def _exchanged(y: Ints, groups: Ints, rng: "np.random.Generator") -> Ints:
    """Classes exchanged among subjects, (permutations, cases)."""
    _, place, sizes = np.unique(groups, return_inverse=True, return_counts=True)
    order = np.argsort(place, kind="stable")
    starts = np.cumsum(sizes) - sizes
    of_group = y[order][starts]
    # Subjects of one class exchange it with each other; others among their own cases.
    has_one = np.bincount(place, of_group[place] != y) == 0
    several = np.flatnonzero(~has_one[place])
    several = several[np.argsort(place[several], kind="stable")]
    exchanged = np.empty((_N_PERMUTATIONS, len(y)), dtype=np.int64)
    for row in exchanged:
        of_group[has_one] = rng.permutation(of_group[has_one])
        row[:] = of_group[place]
        row[several] = y[several[np.lexsort((rng.random(len(several)), place[several]))]]
    return exchanged
