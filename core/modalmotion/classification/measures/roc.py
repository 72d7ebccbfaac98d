"""Receiver operating characteristic of one class against the rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.measures.intervals import Z, design_effect

# Points of a curve that is stored and drawn; more cannot be told apart in a picture.
_MOST_POINTS: Final = 101

RocCurve = tuple[tuple[float, float], ...]
"""1 - specificity and sensitivity at falling thresholds, from (0, 0) to (1, 1)."""


class Auc(NamedTuple):
    """Area under the curve.

    Parameters
    ----------
    value : float
        Probability that a case of the class has a higher score than one of another.
    influences : (cases,) float64
        What each case adds to the value beyond its share; they add up to 0.
    """

    value: float
    influences: NDArray[np.float64]


def auc(scores: NDArray[np.float64], is_class: NDArray[np.bool_]) -> Auc | None:
    """Area under the curve of a score; None where the class, or the rest, has no case.

    Notes
    -----
    Influences are the structural components of DeLong, DeLong and Clarke-Pearson, Comparing the
    areas under two or more correlated receiver operating characteristic curves, Biometrics, 1988.
    """
    m, n = int(is_class.sum()), int((~is_class).sum())
    if not m or not n:
        return None
    ranks = _ranks(scores)
    influences = np.empty(len(scores))
    # Share of the rest below each case of the class, and of the class above each of the rest.
    influences[is_class] = (ranks[is_class] - _ranks(scores[is_class])) / n
    value = float(influences[is_class].mean())
    influences[~is_class] = 1.0 - (ranks[~is_class] - _ranks(scores[~is_class])) / m
    influences[is_class] = (influences[is_class] - value) / m
    influences[~is_class] = (influences[~is_class] - value) / n
    return Auc(value, influences)


def _ranks(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ranks from 1; those that are equal share their mean."""
    _, place, counts = np.unique(scores, return_inverse=True, return_counts=True)
    ranks: NDArray[np.float64] = (np.cumsum(counts) - (counts - 1) / 2)[place]
    return ranks


def auc_interval(
    value: float,
    influences: NDArray[np.float64],
    counts: Sequence[tuple[int, int]],
    subjects: Sequence[str],
) -> tuple[float, float]:
    """95 % interval of an area, or of the mean of several.

    Parameters
    ----------
    value : float
    influences : (cases,) float64
        As in `Auc`; of a mean, their mean.
    counts : sequence of (int, int)
        Cases of the class and of the rest, for each of the areas.
    subjects : sequence of str

    Notes
    -----
    Newcombe, Confidence intervals for an effect size measure based on the Mann-Whitney
    statistic, part 2, Stat Med, 2006, method 5: the areas from which the value is 1.96 standard
    errors away, with the variance of Hanley and McNeil, Radiology, 1982, so that an area of 1
    has a width too. Counts are divided by the design effect of the influences.
    """
    effect = design_effect(influences, subjects)

    def variance(area: float) -> float:
        parts = []
        for m, n in counts:
            more = (m + n) / (2 * effect) - 1
            shape = 1 + more * ((1 - area) / (2 - area) + area / (1 + area))
            parts.append(area * (1 - area) * max(shape, 1.0) * effect**2 / (m * n))
        # Of a mean: as if the areas were one, which is the widest.
        return float(np.mean(parts))

    def bound(end: float) -> float:
        near, far = value, end
        for _ in range(50):
            middle = (near + far) / 2
            if abs(value - middle) < Z * np.sqrt(variance(middle)):
                near = middle
            else:
                far = middle
        return near

    return bound(0.0), bound(1.0)


def roc_curve(scores: NDArray[np.float64], is_class: NDArray[np.bool_]) -> RocCurve:
    """Corners of the curve; empty where the class, or the rest, has no case."""
    m, n = int(is_class.sum()), int((~is_class).sum())
    if not m or not n:
        return ()
    order = np.argsort(-scores, kind="stable")
    last = np.append(np.diff(scores[order]) != 0, True)
    hits = np.cumsum(is_class[order])[last] / m
    alarms = np.cumsum(~is_class[order])[last] / n
    hits, alarms = np.append(0.0, hits), np.append(0.0, alarms)
    keep = np.unique(np.linspace(0, len(hits) - 1, _MOST_POINTS).round().astype(np.int64))
    pairs = zip(alarms[keep].tolist(), hits[keep].tolist(), strict=True)
    return tuple((round(x, 6), round(y, 6)) for x, y in pairs)
