"""Training of a model. scikit-learn is imported here, and only when a model is trained."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sized
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.machine import machine_to_bytes
from modalmotion.classification.estimators.scorer import Blend, Scorer
from modalmotion.classification.estimators.standards import standards
from modalmotion.classification.model.conformal import Calibration, calibrate
from modalmotion.classification.model.digits import rounded
from modalmotion.classification.model.domain import ARRAYS, motion_limits
from modalmotion.classification.model.member import Member
from modalmotion.classification.model.model import Model
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.cases import AnyCase
from modalmotion.classification.training.domain_fit import fit_domain, with_limits
from modalmotion.classification.training.fold_fit import (
    FoldFit,
    MemberFit,
    fit_rows,
    predict_fold,
)
from modalmotion.classification.training.kinds import (
    better,
    collect_kinds,
    kind_note,
    kind_of_table,
    of_better_kind,
)
from modalmotion.classification.training.own_folds import Fold, Folds, folds_of
from modalmotion.classification.training.repetitions import plan_folds
from modalmotion.classification.training.table import CaseTable
from modalmotion.classification.training.training_card import empty_card, training_card
from modalmotion.classification.training.validation import Validation, validated

_N_GOLDEN: Final = 10

# Share of the progress that reading the cases is counted as.
_READ: Final = 0.4

WALLS_NOTE: Final = (
    "Walls are not told apart: the zero of theta is not known, so only features that do not "
    "depend on it are used, and the class does not say where."
)


def train(
    cases: Iterable[AnyCase],
    name: str,
    options: TrainingOptions | None = None,
    progress: Callable[[float, str], None] | None = None,
    cv: Folds | None = None,
    offsets: Iterable[AnyCase] | None = None,
) -> Model:
    """Train a model on labelled recordings.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
        Read a few at a time; nothing but their features is kept. An iterator of sequences is
        held in memory, for these may have to be fitted several times: see `collect_kinds`.
    name : str
    options : TrainingOptions, optional
    progress : callable, optional
        Called with the share that is done, 0 to 1, and the current step.
    cv : splitter of scikit-learn or iterable of (indices, indices), optional
        Folds of your own that predict each case once; indices count the cases from 0. See also
        the options `fold` and `groups`.
    offsets : iterable of TrainingCase or CaseSource, optional
        The same cases with their signatures of the kind offset, where `cases` are signatures and
        both kinds are to be weighed. Sequences are fitted in both by themselves.

    Returns
    -------
    Model

    Raises
    ------
    ParameterError
        If a label is missing, a case cannot be used or does not compare with the others, one
        recording has two classes, or there are fewer than two classes.
    ModalMotionError
        If a case cannot be read or fitted.

    Notes
    -----
    Settings, typical motion and estimator are chosen anew within each fold, so that accuracy,
    calibration and class sets are of cases that took no part in anything.

    Cases are read and folds are fitted through joblib: wherever `parallel.joblib_backend`, or
    joblib's own `parallel_config`, says. The model does not depend on it.
    """
    from joblib import Parallel, delayed

    if options is None:
        options = TrainingOptions()
    report = progress or _silent
    n_cases = len(cases) if isinstance(cases, Sized) else 0
    n_readings = n_cases * (2 if options.kind is None else 1)

    def reading(number: int) -> None:
        share = _READ * (number / n_readings) if n_readings else 0.0
        text = f"reading case {number} of {n_cases}" if n_cases else f"reading case {number}"
        if n_cases and number > n_cases:
            text = "reading the offsets of all cases"
        report(share, text)

    tables = collect_kinds(cases, offsets, options, reading)
    if cv is not None:
        own = _own_folds(tables[0], cv)
        tables = tuple(replace(table, own_folds=own) for table in tables)
    plan = plan_folds(tables[0], options)
    folds = [*plan.folds, *plan.curve]
    works = [delayed(fit_rows)(table, np.arange(len(table)), options) for table in tables]
    works += [
        delayed(predict_fold)(table, fold.inner, fold.outer, options)
        for fold in folds
        for table in tables
    ]
    results = Parallel(return_as="generator", batch_size=1)(works)
    report(_READ, "all cases")
    fits = [next(results) for _ in tables]
    final = better(fits)
    table, fitted = tables[final], fits[final]
    held_out = []
    for number, fold in enumerate(folds):
        report(_READ + (1 - _READ) * (number + 1) / (len(folds) + 1), plan.describe(fold))
        answers = [next(results) for _ in tables]
        held_out.append((fold, of_better_kind(tables, answers, final)))
    options = replace(options, kind=kind_of_table(table))
    validation = validated(table, held_out[: len(plan.folds)], is_grouped=plan.splits.is_grouped)
    model = _model(table, fitted, name, validation, options)
    card = training_card(table, options, plan, validation, held_out, fitted)
    report(1.0, "trained")
    # Of a model that does not read the motion nobody need know how it would have been read.
    weighed = model.no_motion_note
    if model.reads_motion and len(tables) > 1:
        weighed = kind_note(tables, fits)
    notes = (*table.notes, weighed, *plan.splits.notes, *card.notes)
    return replace(model, card=replace(card, notes=tuple(filter(None, notes))))


def _own_folds(table: CaseTable, cv: Folds) -> tuple[Fold, ...]:
    labels = [table.classes[k] for k in table.y]
    return folds_of(cv, table.numbers, table.n_given, labels, table.groups)


def _silent(share: float, text: str) -> None:
    """Report nothing."""
    del share, text


def _model(
    table: CaseTable,
    fitted: FoldFit,
    name: str,
    validation: Validation | None,
    options: TrainingOptions,
) -> Model:
    domain = fit_domain(table, np.arange(len(table))).domain
    least_motion, least_smooth = motion_limits(*table.sizes(domain.reader).T)
    calibration = Calibration(tuple(np.zeros(0) for _ in table.classes))
    if validation is not None:
        # Of the first repetition, as always: see decision 29.
        domain = with_limits(
            domain, validation.scores, validation.hand, validation.groups, options.known_share
        )
        first = validation.answers.probabilities[0]
        calibration = calibrate(first, table.y, len(table.classes))
    X = np.concatenate([member.X for member in fitted.members], axis=1)
    golden = rounded(X[:: max(1, len(X) // _N_GOLDEN)][:_N_GOLDEN])
    always: tuple[str, ...] = ()
    members = tuple(_member(table, member) for member in fitted.members)
    # Where the motion is not read, walls are not looked for either.
    reads_motion = any(member.reader.reads_motion for member in members)
    has_walls = any(member.reader.walls for member in members)
    if _has_closed(table) and reads_motion and not has_walls:
        always = (WALLS_NOTE,)
    arrays: dict[str, Any] = {array: rounded(getattr(domain, array)) for array in ARRAYS}
    model = Model(
        name=name,
        classes=table.classes,
        readable=table.readable,
        members=members,
        temperature=float(rounded(np.array(fitted.temperature))),
        domain=replace(
            domain,
            **arrays,
            least_motion=float(rounded(np.array(least_motion))),
            least_smooth=float(rounded(np.array(least_smooth))),
            hand_temperature=float(rounded(np.array(domain.hand_temperature))),
        ),
        calibration=calibration,
        golden_features=golden,
        golden_probabilities=np.zeros((len(golden), len(table.classes))),
        notes={"": always},
        card=empty_card(table),
        cross_validation=None if validation is None else validation.answers,
    )
    return replace(model, golden_probabilities=model.probabilities(golden))


def _has_closed(table: CaseTable) -> bool:
    topology = table.example.topology
    return topology is not None and bool(topology.closed_axes)


def _member(table: CaseTable, fit: MemberFit) -> Member:
    """Round a fit to the digits that a model keeps."""
    estimator, reader = fit.estimator, fit.reader
    if reader.typical is not None:
        typical = rounded(reader.typical.real) + 1j * rounded(reader.typical.imag)
        reader = replace(reader, typical=typical)
    if (patterns := reader.patterns) is not None:
        pieces, limits = rounded(patterns.pieces), rounded(patterns.limits)
        reader = replace(reader, patterns=replace(patterns, pieces=pieces, limits=limits))
    machine = machine_to_bytes(estimator) if estimator.blend_ is None else b""
    return Member(
        reader=reader,
        columns=table.columns(reader),
        blend=_rounded_blend(estimator, fit.X),
        machine=machine,
        weight=float(rounded(np.array(fit.weight))),
    )


def _rounded_blend(estimator: Any, X: NDArray[np.float64]) -> Blend:
    centre, scale = (rounded(values) for values in standards(X))
    if estimator.blend_ is None:
        return Blend(centre, scale, (), 1.0)
    scorers = tuple(
        Scorer(
            rounded(s.anchors),
            float(s.gamma),
            rounded(s.weights),
            rounded(s.intercepts),
            float(rounded(np.array(s.temperature))),
        )
        for s in estimator.blend_.scorers
    )
    return Blend(centre, scale, scorers, float(rounded(np.array(estimator.blend_.temperature))))
