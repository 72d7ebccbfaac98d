"""The card of a model that was just trained."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.model.card import ModelCard
from modalmotion.classification.model.conformal import calibrate
from modalmotion.classification.model.reliability import calibration_curve, calibration_error
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.fold_fit import FoldFit
from modalmotion.classification.training.intervals import accuracy_interval
from modalmotion.classification.training.splits import Splits
from modalmotion.classification.training.table import CaseTable, class_counts
from modalmotion.hdf5.image import INTENDED_USE

# Fewer calibration cases than this make sets of the usual 90 % hold a class always.
_FEW: Final = 9


def empty_card(table: CaseTable) -> ModelCard:
    """Card of a model before its training."""
    return ModelCard(
        classes=table.classes,
        training_set=table.hash,
        n_cases={},
        n_subjects={},
        accuracy=None,
        accuracy_interval=None,
        is_grouped=False,
        confusion=(),
        calibration_curve=(),
        calibration_error=None,
        coverage=0.9,
        class_coverage={},
        mean_set_size=None,
        options={},
        versions={},
        intended_use=INTENDED_USE,
        has_seen="",
        has_not_seen="",
    )


def training_card(
    table: CaseTable,
    options: TrainingOptions,
    splits: Splits,
    probabilities: NDArray[np.float64],
    fitted: FoldFit,
) -> ModelCard:
    """Card of a trained model: its data, options, and accuracy on held-out cases.

    Parameters
    ----------
    table : CaseTable
    options : TrainingOptions
    splits : Splits
    probabilities : (cases, classes) float64
        Of each case, when it was held out.
    fitted : FoldFit
        To all cases.
    """
    labels = [table.classes[k] for k in table.y]
    pairs = dict.fromkeys(zip(labels, table.subjects, strict=True))
    n_cases, n_subjects = class_counts(labels), class_counts(label for label, _ in pairs)
    few = [label for label, count in n_cases.items() if count < _FEW]
    notes: tuple[str, ...] = ()
    if few:
        notes = (
            (
                f"Fewer than {_FEW} cases of {', '.join(few)}: class sets of 90 % always hold "
                f"{'it' if len(few) == 1 else 'them'}."
            ),
        )
    card = replace(
        empty_card(table),
        n_cases=n_cases,
        n_subjects=n_subjects,
        is_grouped=splits.is_grouped,
        coverage=options.coverage,
        options={
            **options.as_json(),
            "chosen": fitted.members[0].estimator.kind_,
            "features": [[name, round(weight, 3)] for name, weight in fitted.choices],
        },
        versions={p: version(p) for p in ("modalmotion", "numpy", "scipy", "scikit-learn")},
        has_seen=(
            f"{len(table)} recordings of {len(set(table.subjects))} subjects: "
            + ", ".join(f"{count} {label}" for label, count in n_cases.items())
            + f"; {' or '.join(table.readable.topologies)}, {table.readable.n_modes} modes."
        ),
        has_not_seen=(
            "Any other class, subject, device or way to segment: the figures hold for recordings "
            "like these only."
        ),
        notes=notes,
    )
    if not splits.folds:
        return card
    answers = probabilities.argmax(axis=1)
    right = answers == table.y
    confusion = np.zeros((len(table.classes),) * 2, dtype=np.int64)
    np.add.at(confusion, (table.y, answers), 1)
    curve = calibration_curve(probabilities.max(axis=1), right)
    held, sizes = _cross_sets(table, splits.folds, probabilities, options.coverage)
    return replace(
        card,
        accuracy=float(right.mean()),
        accuracy_interval=accuracy_interval(right, table.subjects),
        confusion=tuple(tuple(row) for row in confusion.tolist()),
        calibration_curve=curve,
        calibration_error=calibration_error(curve),
        class_coverage={
            label: float(held[table.y == k].mean()) for k, label in enumerate(table.classes)
        },
        mean_set_size=float(sizes.mean()),
    )


def _cross_sets(
    table: CaseTable,
    folds: list[tuple[NDArray[np.int64], NDArray[np.int64]]],
    probabilities: NDArray[np.float64],
    coverage: float,
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Whether each case's set, calibrated on the other folds, holds its class; and its size."""
    held = np.zeros(len(table), dtype=np.bool_)
    sizes = np.zeros(len(table), dtype=np.int64)
    for inner, outer in folds:
        fold = calibrate(probabilities[inner], table.y[inner], len(table.classes))
        in_set = fold.holds(probabilities[outer], coverage)
        held[outer] = in_set[np.arange(len(outer)), table.y[outer]]
        sizes[outer] = in_set.sum(axis=1)
    return held, sizes
