"""Intervals of shares, losses and areas under curves for subjects not seen, and the curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from modalmotion.representation import Bools, Floats

Interval = tuple[float, float]

Curve = tuple[tuple[float, float, int], ...]
"""Mean probability, share that was right and number of answers, by bins."""

RocCurve = tuple[tuple[float, float], ...]
"""1 - specificity and sensitivity at falling thresholds, from (0, 0) to (1, 1)."""

Z: Final = 1.959963984540054
"""97.5 % quantile of a standard normal."""

# Bins of a calibration curve, and the least cases of one.
_N_BINS: Final = 10
_LEAST_IN_BIN: Final = 5
# Points of a curve that is stored and drawn; more cannot be distinguished in a picture.
_MOST_POINTS: Final = 101


def design_effect(residuals: Floats, subjects: Sequence[str]) -> float:
    """Factor by which a mean over cases varies more than one over independent cases.

    Parameters
    ----------
    residuals : (cases,) float64
        Of each case, what it adds to the mean beyond its share; they add up to 0.
    subjects : sequence of str
        Who each case is of. Cases of one subject are alike, so they count as fewer.

    Notes
    -----
    Kish, Survey sampling, 1965: variance of the mean between subjects over that of independent
    cases, never below 1.
    """
    n = len(residuals)
    _, place = np.unique(np.asarray(subjects), return_inverse=True)
    sizes = np.bincount(place)
    m = len(sizes)
    if m == n:
        return 1.0
    # All cases of a subject alike is the worst that can be.
    worst = float((sizes**2).sum() / n)
    independent = float((residuals**2).sum())
    if m == 1 or independent <= 0:
        return worst
    between = float((np.bincount(place, residuals) ** 2).sum()) * m / (m - 1)
    return min(max(1.0, between / independent), worst)


def share_interval(right: NDArray[np.generic], subjects: Sequence[str]) -> tuple[float, float]:
    """95 % interval of the share that is right, for subjects that have not been seen.

    Parameters
    ----------
    right : (cases,) bool, or float64 from 0 to 1
        At least one; of several answers to a case the share that is right.
    subjects : sequence of str
        As in `design_effect`.

    Returns
    -------
    (float, float)

    Notes
    -----
    `wilson_interval` of n / `design_effect` cases.
    """
    shares = np.asarray(right, dtype=np.float64)
    p = float(shares.mean())
    low, high = wilson_interval(p, len(shares) / design_effect(shares - p, subjects))
    return float(low), float(high)


def wilson_interval(share: ArrayLike, n: ArrayLike) -> Floats:
    """95 % interval of shares of n independent cases, low and high ends, (2, ...) float64.

    Wilson, Probable inference, J Am Stat Assoc, 1927.
    """
    p, m = np.asarray(share, dtype=np.float64), np.asarray(n, dtype=np.float64)
    centre = (p + Z**2 / (2 * m)) / (1 + Z**2 / m)
    half = Z / (1 + Z**2 / m) * np.sqrt(p * (1 - p) / m + Z**2 / (4 * m**2))
    return np.stack([np.maximum(centre - half, 0.0), np.minimum(centre + half, 1.0)])


def loss_interval(
    losses: Floats, subjects: Sequence[str], most: float = np.inf
) -> tuple[float, float] | None:
    """95 % interval of a mean of losses, none below 0; None for one case or one subject.

    Parameters
    ----------
    losses : (cases,) float64
    subjects : sequence of str
        As in `design_effect`.
    most : float
        That a loss can be.

    Notes
    -----
    Normal, with the variance of the mean times its `design_effect`.
    """
    n, mean = len(losses), float(losses.mean())
    if len(set(subjects)) < 2:
        return None
    residuals = losses - mean
    variance = float((residuals**2).sum()) / (n - 1) / n * design_effect(residuals, subjects)
    half = Z * np.sqrt(variance)
    return max(0.0, float(mean - half)), min(most, float(mean + half))


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
    influences: Floats


def auc(scores: Floats, is_class: Bools) -> Auc:
    """Area under the curve of a score; the class has cases, and so has the rest.

    Notes
    -----
    Influences are the structural components of DeLong, DeLong and Clarke-Pearson, Comparing the
    areas under two or more correlated receiver operating characteristic curves, Biometrics, 1988.
    """
    m, n = int(is_class.sum()), int((~is_class).sum())
    positive, negative = scores[is_class], scores[~is_class]
    # Share of the rest below each case of the class, and of the class above each of the rest.
    shares = np.empty(len(scores))
    shares[is_class] = _below(negative, positive)
    shares[~is_class] = 1.0 - _below(positive, negative)
    value = float(shares[is_class].mean())
    return Auc(value, (shares - value) / np.where(is_class, m, n))


def _below(others: Floats, scores: Floats) -> Floats:
    """Share of the others below each score; equal ones count by half."""
    ranked = np.sort(others)
    twice = np.searchsorted(ranked, scores) + np.searchsorted(ranked, scores, "right")
    return twice / (2.0 * len(others))


def auc_interval(
    value: float, influences: Floats, counts: Sequence[tuple[int, int]], subjects: Sequence[str]
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

    def beyond(area: float) -> float:
        return abs(value - area) - Z * float(np.sqrt(variance(area)))

    def bound(end: float) -> float:
        # At an area of 1 the variance is 0, and just below it is not.
        near = value + 1e-9 * (end - value)
        return value if value == end else float(scipy.optimize.brentq(beyond, near, end))

    return bound(0.0), bound(1.0)


def roc_curve(scores: Floats, is_class: Bools) -> RocCurve:
    """Corners of the curve; empty if the class, or the rest, has no case."""
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


def calibration_curve(confidence: Floats, right: Bools, n_repetitions: int = 1) -> Curve:
    """Mean probability of the label, share that was right and number of cases, by bins.

    Parameters
    ----------
    confidence : (cases,) float64
        Probability of the label.
    right : (cases,) bool
    n_repetitions : int
        How often each case is among them.

    Returns
    -------
    tuple of (float, float, int)
        One for each of ten bins of equal count, from the least sure to the surest; fewer where a
        bin would contain fewer than five cases.

    Notes
    -----
    Nguyen and O'Connor, Posterior calibration and exploratory analysis for natural language
    processing models, EMNLP, 2015. Bins of equal width leave most of them nearly empty if
    most answers are sure.
    """
    order = np.argsort(confidence, kind="stable")
    n_bins = min(_N_BINS, max(1, len(order) // (_LEAST_IN_BIN * n_repetitions)))
    return tuple(
        (round(float(confidence[b].mean()), 6), round(float(right[b].mean()), 6), len(b))
        for b in np.array_split(order, n_bins)
        if len(b)
    )


def calibration_error(curve: Curve) -> float:
    """Give the expected calibration error of a curve: its mean distance from the diagonal.

    Naeini, Cooper and Hauskrecht, Obtaining well calibrated probabilities using Bayesian
    binning, AAAI, 2015.
    """
    n = sum(count for _, _, count in curve)
    return sum(abs(mean - share) * count for mean, share, count in curve) / max(n, 1)
