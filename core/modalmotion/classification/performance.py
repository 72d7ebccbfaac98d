"""Figures of answers to labelled cases, with their intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from modalmotion.classification.intervals import (
    Auc,
    Curve,
    Interval,
    RocCurve,
    auc,
    auc_interval,
    calibration_curve,
    calibration_error,
    loss_interval,
    roc_curve,
    share_interval,
)
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
    accuracy_interval: Interval
    balanced_accuracy: float
    auc: float | None
    auc_interval: Interval | None
    class_auc: dict[str, Measured]
    log_loss: float
    log_loss_interval: Interval | None
    brier: float
    brier_interval: Interval | None
    sensitivity: dict[str, Measured]
    specificity: dict[str, Measured]
    confusion: tuple[tuple[int, ...], ...]
    roc: dict[str, RocCurve]
    calibration_curve: Curve
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


def macro_area(answers: Answers) -> tuple[Auc | None, Interval | None, dict[str, Measured]]:
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


def _mean_area(areas: Sequence[Auc]) -> Auc:
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
