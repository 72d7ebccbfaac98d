"""Labelled cases that a model can be asked about."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from modalmotion.classification.answer.classifier import fitted_for
from modalmotion.classification.model.model import Model
from modalmotion.classification.training.cases import AnyCase, TrainingCase
from modalmotion.classification.training.left_out import UNUSABLE, LeftOut
from modalmotion.mesh.sequence import MeshSequence


def usable_cases(
    model: Model, cases: Iterable[AnyCase], left_out: list[LeftOut]
) -> Iterator[TrainingCase]:
    """Read cases and fit their sequences for a model, going on without those that fail.

    Parameters
    ----------
    model : Model
    cases : iterable of TrainingCase or CaseSource
    left_out : list of LeftOut
        Those that fail are added to it.

    Yields
    ------
    TrainingCase
        With a signature.
    """
    for _, (case,) in cases_for_models((model,), cases, left_out):
        yield case


def cases_for_models(
    models: Sequence[Model], cases: Iterable[AnyCase], left_out: list[LeftOut]
) -> Iterator[tuple[int, tuple[TrainingCase, ...]]]:
    """Read cases and fit each for all of several models, as `usable_cases` does.

    Yields
    ------
    (int, tuple of TrainingCase)
        Number of the case, from 0, and for each model the case with a signature.
    """
    for number, source in enumerate(cases):
        try:
            case = source if isinstance(source, TrainingCase) else source.read()
            fitted = tuple(_fitted(case, model) for model in models)
        except UNUSABLE as error:
            left_out.append(LeftOut.of(error, source.name or f"case {number}"))
            continue
        yield number, fitted


def _fitted(case: TrainingCase, model: Model) -> TrainingCase:
    if not isinstance(case.motion, MeshSequence):
        return case
    return replace(case, motion=fitted_for(model, case.motion))
