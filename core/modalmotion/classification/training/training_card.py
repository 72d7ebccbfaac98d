"""The card of a model that was just trained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.measures.confounds import confound_notes, confounds
from modalmotion.classification.measures.performance import METHODS, performance, spread
from modalmotion.classification.model.card import ModelCard
from modalmotion.classification.model.conformal import calibrate
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.collection import class_counts
from modalmotion.classification.training.fold_fit import FoldFit, HeldOut
from modalmotion.classification.training.learning_curve import learning_curve
from modalmotion.classification.training.repetitions import Plan, PlannedFold
from modalmotion.classification.training.table import CaseTable
from modalmotion.classification.training.validation import Validation
from modalmotion.hdf5.image import INTENDED_USE

# Fewer calibration cases than this make sets of the usual 90 % hold a class always.
_FEW: Final = 9

# Fewer cases than these, in all or of a class, make figures that say little.
_FEW_IN_ALL: Final = 10
_FEW_OF_A_CLASS: Final = 5


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
    plan: Plan,
    validation: Validation | None,
    folds: Sequence[tuple[PlannedFold, HeldOut]],
    fitted: FoldFit,
) -> ModelCard:
    """Card of a trained model: its data, options, and accuracy on held-out cases.

    Parameters
    ----------
    table : CaseTable
    options : TrainingOptions
    plan : Plan
    validation : Validation or None
        Of the folds of the plan.
    folds : sequence of (PlannedFold, HeldOut)
        Of the plan, the learning curve's after those of the cross-validation.
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
        is_grouped=plan.splits.is_grouped,
        coverage=options.coverage,
        options={
            **options.as_json(),
            "chosen": fitted.members[0].estimator.kind_,
            "features": tuple((name, round(weight, 3)) for name, weight in fitted.choices),
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
    if validation is None:
        return card
    answers = validation.answers.answers()
    held, sizes = _cross_sets(table, plan.splits.folds, answers.probabilities[0], options.coverage)
    people = np.unique(table.subjects, return_inverse=True)[1]
    tests = confounds(table.conditions, table.y, people, options.seed)
    return replace(
        card,
        **vars(performance(answers)),
        methods=METHODS,
        repetitions=spread(answers),
        learning_curve=learning_curve(table, folds) if plan.curve else (),
        fold_choices=tuple(
            {
                "repetition": fold.repetition + 1,
                "fold": fold.fold + 1,
                "choices": tuple((text, round(weight, 6)) for text, weight in held_out.choices),
            }
            for fold, held_out in folds
            if fold.size is None
        ),
        confounds=tests,
        notes=(*_of_few(n_cases), *notes, *confound_notes(tests)),
        class_coverage={
            label: float(held[table.y == k].mean()) for k, label in enumerate(table.classes)
        },
        mean_set_size=float(sizes.mean()),
    )


def _of_few(n_cases: dict[str, int]) -> tuple[str, ...]:
    """Say that figures of few cases are no certainty."""
    n, least = sum(n_cases.values()), min(n_cases.values())
    if n >= _FEW_IN_ALL and least >= _FEW_OF_A_CLASS:
        return ()
    of = "" if n < _FEW_IN_ALL else f", {least} of {min(n_cases, key=lambda k: n_cases[k])},"
    note = (
        f"Figures of {n} cases{of} say little: even where all of them are right, or a loss is 0, "
        "that is no certainty. Heed the intervals, and train or test on more."
    )
    return (note,)


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
