"""The kinds of signature that a cohort may be read in, and which of them predicts better."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.basis import collect_in_one_basis
from modalmotion.classification.training.cases import AnyCase
from modalmotion.classification.training.fold_fit import FoldFit, HeldOut
from modalmotion.classification.training.table import CaseTable
from modalmotion.errors import ModalMotionError
from modalmotion.signature.making import SignatureKind

# Standard errors by which offsets must lower the loss of cases left out.
_SURE: Final = 1.0


def collect_kinds(
    cases: Iterable[AnyCase],
    offsets: Iterable[AnyCase] | None,
    options: TrainingOptions,
    progress: Callable[[int], None] | None = None,
) -> tuple[CaseTable, ...]:
    """Read the features of a cohort in each kind of signature that may suit it.

    Recordings that state what their points follow are read so. Where some do not, they are read
    as displacements and as offsets, except on shapes that have no offsets.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
    offsets : iterable of TrainingCase or CaseSource, or None
        The same cases with their signatures of the kind offset, where `cases` are signatures.
    options : TrainingOptions
        With a kind, that one alone is read.
    progress : callable, optional
        Called with the number of readings that are done.

    Returns
    -------
    tuple of CaseTable
        One or two, of the same cases; displacements first.

    Raises
    ------
    ModalMotionError
        See `collect_in_one_basis`.
    """
    if options.kind is not None:
        return (collect_in_one_basis(cases, options, progress),)
    # They may be read twice.
    cohort = list(cases) if iter(cases) is cases else cases
    first = collect_in_one_basis(cohort, options, progress)
    if first.trackings == {SignatureKind.MATERIAL} or not (first.is_fitted or offsets):
        return (first,)
    try:
        second = collect_in_one_basis(
            cohort if offsets is None else offsets,
            replace(options, kind=SignatureKind.OFFSET),
            None if progress is None else lambda done: progress(first.n_given + done),
        )
    except ModalMotionError:
        return (first,)
    if first.trackings == {SignatureKind.OFFSET}:
        return (second,)
    return (first, second) if np.array_equal(first.numbers, second.numbers) else (first,)


def better(fits: Sequence[FoldFit | HeldOut]) -> int:
    """Place of the fit that predicts cases left out better.

    The first, of displacements, unless that of offsets gains more than one standard error: they
    hold less, and what they gain by chance is lost on others.
    """
    first, *others = (fit.losses for fit in fits)
    return int(any(first.surely_above(other, _SURE) for other in others))


def kind_of_table(table: CaseTable) -> SignatureKind:
    """Kind of the signatures that were read."""
    return SignatureKind(table.example.kind)


def kind_note(tables: Sequence[CaseTable], fits: Sequence[FoldFit]) -> str:
    """Say which kind a model reads, and by what losses it was chosen."""
    best = better(fits)
    losses = {kind_of_table(t): f.losses.mean for t, f in zip(tables, fits, strict=True)}
    said = ", ".join(f"{kind} {loss:.3f}" for kind, loss in losses.items())
    return (
        "The recordings do not state whether their points follow the tissue. Both kinds of "
        "signature were weighed, inside each fold too, and the model reads "
        f"{kind_of_table(tables[best])}. They were weighed by losses within training, on which "
        f"choices are made too: {said}. These are not of held-out folds, so do not compare them "
        "with the card's log loss. State the option kind to decide otherwise."
    )


def of_better_kind(tables: Sequence[CaseTable], answers: Sequence[HeldOut], final: int) -> HeldOut:
    """Answers of a fold by the kind that it chose, judged by the domain of the final model."""
    if len(tables) == 1:
        return answers[0]
    best = better(answers)
    kind = kind_of_table(tables[best])
    return answers[best]._replace(
        judgement=answers[final].judgement,
        choices=tuple((f"{kind}: {name}", weight) for name, weight in answers[best].choices),
    )
