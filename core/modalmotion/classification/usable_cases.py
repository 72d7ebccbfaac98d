"""Labelled cases that a model can be asked about."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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
    for number, source in enumerate(cases):
        try:
            case = source if isinstance(source, TrainingCase) else source.read()
            if isinstance(case.motion, MeshSequence):
                case = replace(case, motion=fitted_for(model, case.motion))
        except UNUSABLE as error:
            left_out.append(LeftOut.of(error, source.name or f"case {number}"))
            continue
        yield case
