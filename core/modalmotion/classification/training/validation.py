"""The answers of all folds of a cross-validation, put together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.model.cross_validation import CrossValidation
from modalmotion.classification.model.digits import rounded
from modalmotion.classification.model.domain import CHECKS
from modalmotion.classification.training.fold_fit import HeldOut
from modalmotion.classification.training.repetitions import PlannedFold
from modalmotion.classification.training.table import CaseTable


class Validation(NamedTuple):
    """Cross-validation of a training set.

    Parameters
    ----------
    answers : CrossValidation
    scores : (cases, checks) float64
        See `Judgement`; these are of the first repetition.
    hand : (cases,) float64
    groups : (cases,) int64
        Cases that are not independent of one another.
    """

    answers: CrossValidation
    scores: NDArray[np.float64]
    hand: NDArray[np.float64]
    groups: NDArray[np.int64]


def validated(
    table: CaseTable, folds: Sequence[tuple[PlannedFold, HeldOut]], *, is_grouped: bool
) -> Validation | None:
    """Put the answers of folds together; None where there was no fold."""
    if not folds:
        return None
    n, n_repetitions = len(table), 1 + max(fold.repetition for fold, _ in folds)
    probabilities = np.zeros((n_repetitions, n, len(table.classes)))
    numbers = np.zeros((n_repetitions, n), dtype=np.int64)
    scores, hand = np.zeros((n, len(CHECKS))), np.zeros(n)
    for fold, held_out in folds:
        probabilities[fold.repetition, fold.outer] = held_out.probabilities
        numbers[fold.repetition, fold.outer] = fold.fold
        if fold.repetition == 0:
            scores[fold.outer] = held_out.judgement.named(table.y[fold.outer])
            hand[fold.outer] = held_out.judgement.hand
    answers = CrossValidation(
        classes=table.classes,
        sequence_ids=table.sequence_ids,
        names=table.names,
        subjects=table.subjects,
        y=table.y,
        # Figures too must not depend on the number of threads.
        probabilities=rounded(probabilities),
        folds=numbers,
    )
    return Validation(answers, scores, hand, table.groups if is_grouped else np.arange(n))
