"""The learning curve: how well models of fewer cases do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from modalmotion.classification.measures.performance import Answers, spread
from modalmotion.classification.training.fold_fit import HeldOut
from modalmotion.classification.training.repetitions import PlannedFold
from modalmotion.classification.training.table import CaseTable

CurvePoint = dict[str, Any]
"""per_class (the most of any class), n_cases (the mean of the folds), accuracy, auc,
log_loss (means over repetitions), and the least and largest of each repetition as accuracy_range,
auc_range and log_loss_range."""


def learning_curve(
    table: CaseTable, folds: Sequence[tuple[PlannedFold, HeldOut]]
) -> tuple[CurvePoint, ...]:
    """Measure the answers of all folds by the number of cases that were fitted to.

    Parameters
    ----------
    table : CaseTable
    folds : sequence of (PlannedFold, HeldOut)
        Of the curve, and those of the cross-validation, which are its last point.

    Returns
    -------
    tuple of CurvePoint
    """
    sizes = sorted({fold.size for fold, _ in folds if fold.size is not None})
    return tuple(
        _point(table, [pair for pair in folds if pair[0].size == size], size)
        for size in (*sizes, None)
    )


def _point(
    table: CaseTable, folds: Sequence[tuple[PlannedFold, HeldOut]], size: int | None
) -> CurvePoint:
    n_draws = 1 + max(fold.repetition for fold, _ in folds)
    shares = np.zeros((n_draws, len(table), len(table.classes)))
    for fold, held_out in folds:
        shares[fold.repetition, fold.outer] = held_out.probabilities
    answers = Answers(table.classes, table.y, table.subjects, shares, shares.argmax(axis=2))
    n_cases = float(np.mean([len(fold.inner) for fold, _ in folds]))
    most = max(int(np.bincount(table.y[fold.inner]).max()) for fold, _ in folds)
    point: CurvePoint = {
        "per_class": most if size is None else size,
        "n_cases": round(n_cases),
    }
    repeated = spread(answers)
    for name in ("accuracy", "auc", "log_loss"):
        values = [figure for each in repeated if (figure := each[name]) is not None]
        point[name] = float(np.mean(values)) if values else None
        point[f"{name}_range"] = (min(values), max(values)) if values else None
    return point
