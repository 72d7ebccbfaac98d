"""Figures of answers to labelled cases, with their intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from modalmotion.representation import Bools, Floats, Ints, csv_text, shown

Measured = tuple[float, float, float]
"""A value, and the ends of its 95 % interval."""

METHODS: Final = (
    "Intervals are of 95 %, for subjects that have not been seen; cases of one subject count as "
    "fewer (design effect, Kish 1965). Accuracy, sensitivity, specificity: Wilson 1927. AUC (one "
    "class against the rest; their mean is the macro AUC): Newcombe 2006, method 5. Log loss "
    "(nats) and Brier score (sum over the classes, 0 to 2): normal. Expected calibration error: "
    "ten bins of equal count."
)
"""How the figures and their intervals are made."""

# No probability is 0, but a fold may not have seen a class.
_LEAST: Final = float(np.finfo(np.float64).eps)

# All on another class.
_MOST_BRIER: Final = 2.0


@shown("accuracy", "accuracy_interval", "auc", "log_loss", "calibration_error")
@dataclass(frozen=True, kw_only=True)
class Performance:
    """Figures of the answers to labelled cases; see `METHODS`.

    Parameters
    ----------
    accuracy : float
        Share of all answers with the right label; an abstention counts as wrong.
    accuracy_interval : (float, float)
        95 % interval, wider where several cases are of one subject.
    balanced_accuracy : float
        Mean over classes of the share that was right.
    auc : float or None
        Macro area under the ROC curves; None if only one class is there.
    auc_interval : (float, float) or None
    class_auc : dict of str to (float, float, float)
        Of each class against the rest, with its interval.
    log_loss : float, nats
    log_loss_interval : (float, float) or None
        None if all cases are of one subject.
    brier : float
        Sum over the classes of squared differences, 0 to 2.
    brier_interval : (float, float) or None
    sensitivity : dict of str to (float, float, float)
        Share of a class that was answered as such, with its interval.
    specificity : dict of str to (float, float, float)
        Share of the others that was not, with its interval.
    confusion : tuple of tuple of int
        Rows are true classes, columns answers; where an answer may be without a label, the last
        column counts these. Of repeated folds the sum.
    roc : dict of str to tuple of (float, float)
        1 - specificity and sensitivity of each class at falling thresholds.
    calibration_curve : tuple of (float, float, int)
        Mean probability of the label, share that was right, number of answers, by bins of equal
        count.
    calibration_error : float
        Expected calibration error (ECE) of the answers with a label; of repeated folds the mean.
    """

    accuracy: float
    accuracy_interval: "Interval"
    balanced_accuracy: float
    auc: float | None
    auc_interval: "Interval | None"
    class_auc: dict[str, Measured]
    log_loss: float
    log_loss_interval: "Interval | None"
    brier: float
    brier_interval: "Interval | None"
    sensitivity: dict[str, Measured]
    specificity: dict[str, Measured]
    confusion: tuple[tuple[int, ...], ...]
    roc: "dict[str, RocCurve]"
    calibration_curve: "Curve"
    calibration_error: float


@dataclass(frozen=True, eq=False)
class Answers:
    """Answers to labelled cases, several times where folds are repeated.

    Parameters
    ----------
    classes : tuple of str
    y : (cases,) int64
        True classes.
    subjects : sequence of str
    probabilities : (repetitions, cases, classes) float64
    labels : (repetitions, cases) int64
        Answers; -1 for none.
    """

    classes: tuple[str, ...]
    y: Ints
    subjects: Sequence[str]
    probabilities: Floats
    labels: Ints

    @property
    def right(self) -> Bools:
        """Whether each label is right, (repetitions, cases)."""
        return np.asarray(self.labels == self.y)

    @property
    def log_losses(self) -> Floats:
        """Log loss of each answer, (repetitions, cases), nats."""
        shares = self.probabilities[:, np.arange(len(self.y)), self.y]
        return np.asarray(-np.log(np.maximum(shares, _LEAST)))

    @property
    def briers(self) -> Floats:
        """Brier score of each answer, (repetitions, cases)."""
        return np.asarray(
            ((self.probabilities - np.eye(len(self.classes))[self.y]) ** 2).sum(axis=2)
        )


def performance(answers: Answers, *, abstains: bool = False) -> Performance:
    """Measure answers.

    Parameters
    ----------
    answers : Answers
        To at least one case.
    abstains : bool
        Whether an answer may be without a label.
    """
    y, n = answers.y, len(answers.classes)
    every = np.tile(y, len(answers.probabilities))
    right, labelled = answers.right, answers.labels >= 0
    confusion = np.zeros((n, n + 1), dtype=np.int64)
    np.add.at(confusion, (every, answers.labels.ravel()), 1)
    confidence = answers.probabilities.max(axis=2)
    losses, briers = answers.log_losses.mean(axis=0), answers.briers.mean(axis=0)
    sensitivity = _by_class(answers, lambda k: answers.labels == k, is_class=True)
    specificity = _by_class(answers, lambda k: answers.labels != k, is_class=False)
    area, area_interval, by_class = macro_area(answers)
    curves = [
        calibration_curve(c[has], hit[has])
        for c, hit, has in zip(confidence, right, labelled, strict=True)
    ]
    return Performance(
        accuracy=float(right.mean()),
        accuracy_interval=share_interval(right.mean(axis=0), answers.subjects),
        balanced_accuracy=float(np.mean([value for value, _, _ in sensitivity.values()])),
        auc=area and area.value,
        auc_interval=area_interval,
        class_auc=by_class,
        log_loss=float(losses.mean()),
        log_loss_interval=loss_interval(losses, answers.subjects),
        brier=float(briers.mean()),
        brier_interval=loss_interval(briers, answers.subjects, _MOST_BRIER),
        sensitivity=sensitivity,
        specificity=specificity,
        confusion=tuple(
            tuple(row) for row in (confusion if abstains else confusion[:, :n]).tolist()
        ),
        roc={
            label: curve
            for k, label in enumerate(answers.classes)
            if (curve := roc_curve(answers.probabilities[:, :, k].ravel(), every == k))
        },
        calibration_curve=calibration_curve(
            confidence[labelled], right[labelled], len(answers.labels)
        ),
        calibration_error=float(np.mean([calibration_error(curve) for curve in curves])),
    )


def _by_class(
    answers: Answers, hits: Callable[[int], Bools], *, is_class: bool
) -> dict[str, Measured]:
    """Share of the cases of each class, or of no such class, for which something holds."""
    shares, subjects = {}, np.array(answers.subjects)
    for k, label in enumerate(answers.classes):
        rows = (answers.y == k) == is_class
        if rows.any():
            mine = hits(k)[:, rows].mean(axis=0)
            shares[label] = (float(mine.mean()), *share_interval(mine, subjects[rows]))
    return shares


def macro_area(answers: Answers) -> "tuple[Auc | None, Interval | None, dict[str, Measured]]":
    """Mean area over the classes that occur, its interval, and the area of each with its own."""
    areas: dict[str, Measured] = {}
    found, counts = [], []
    for k, label in enumerate(answers.classes):
        is_class = answers.y == k
        count = int(is_class.sum()), int((~is_class).sum())
        if 0 in count:
            continue
        own = _mean_area([auc(shares, is_class) for shares in answers.probabilities[:, :, k]])
        areas[label] = own.value, *auc_interval(*own, [count], answers.subjects)
        found.append(own)
        counts.append(count)
    if not found:
        return None, None, {}
    macro = _mean_area(found)
    return macro, auc_interval(*macro, counts, answers.subjects), areas


def _mean_area(areas: "Sequence[Auc]") -> "Auc":
    values, influences = zip(*areas, strict=True)
    return Auc(float(np.mean(values)), np.mean(influences, axis=0))


@shown("probabilities", "classes")
@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Answers to the training cases, each from folds that it took no part in.

    Parameters
    ----------
    classes : tuple of str
    sequence_ids : tuple of str
        Of the cases.
    names : tuple of str
        What the cases are called, such as paths; empty once it was in a file, which names nobody.
    subjects : tuple of str
        Once it was in a file "subject 1" and so on.
    y : (cases,) int64
        True classes.
    probabilities : (repetitions, cases, classes) float64
    folds : (repetitions, cases) int64
        In which fold each case was held out, from 0.
    """

    classes: tuple[str, ...]
    sequence_ids: tuple[str, ...]
    names: tuple[str, ...]
    subjects: tuple[str, ...]
    y: Ints
    probabilities: Floats
    folds: Ints

    def answers(self) -> Answers:
        """Give the answers to measure: the most probable classes."""
        labels = self.probabilities.argmax(axis=2)
        return Answers(self.classes, self.y, self.subjects, self.probabilities, labels)

    def as_csv(self, names: Mapping[str, tuple[str, str]] | None = None) -> str:
        """Write the probabilities as a table, a line for each case and repetition.

        Parameters
        ----------
        names : mapping of sequence id to (str, str), optional
            Name and subject of cases, which a file does not hold.

        Returns
        -------
        str
            With the columns case, sequence_id, subject, class, repetition, fold, answer and one
            for each class; repetitions and folds count from 1.
        """
        known = names or {}
        lines = [
            ["case", "sequence_id", "subject", "class", "repetition", "fold", "answer"]
            + [f"p {label}" for label in self.classes]
        ]
        for repetition, (shares, folds) in enumerate(
            zip(self.probabilities, self.folds, strict=True)
        ):
            for i, sequence_id in enumerate(self.sequence_ids):
                name, subject = known.get(sequence_id, (self.names[i], self.subjects[i]))
                answer = self.classes[int(shares[i].argmax())]
                lines.append(
                    [name, sequence_id, subject, self.classes[self.y[i]]]
                    + [str(repetition + 1), str(folds[i] + 1), answer]
                    + [f"{share:.6g}" for share in shares[i]]
                )
        return csv_text(lines)


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
    # Share of the rest below each case of the class, and of the class above each of the rest.
    shares = _ranks(scores)
    for rows, n_others in ((is_class, n), (~is_class, m)):
        shares[rows] = (shares[rows] - _ranks(scores[rows])) / n_others
    shares[~is_class] = 1.0 - shares[~is_class]
    value = float(shares[is_class].mean())
    return Auc(value, (shares - value) / np.where(is_class, m, n))


def _ranks(scores: Floats) -> Floats:
    """Ranks from 1; equal scores have the mean of theirs."""
    _, place, counts = np.unique(scores, return_inverse=True, return_counts=True)
    ranks: Floats = (np.cumsum(counts) - (counts - 1) / 2.0)[place]
    return ranks


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
