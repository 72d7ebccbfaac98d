"""Models measured by their answers to labelled sequences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from modalmotion.classification.comparison import comparison_of
from modalmotion.classification.evaluation import (
    CaseAnswer,
    Evaluation,
    evaluation_of,
)
from modalmotion_service.http.negotiation import CSV, PNG
from modalmotion_service.schemas.models import ComparisonAnswer, EvaluationAnswer
from modalmotion_service.work.tasks.classification import loaded
from modalmotion_service.work.tasks.files import png_of

Model = Path | str


def measure(
    model: Model, version: int, answers: Sequence[CaseAnswer], coverage: float, media_type: str
) -> bytes:
    """Measure a model's answers, as JSON, as a table of the cases, or as a picture."""
    result = _evaluation(model, answers, coverage)
    if media_type == CSV:
        return result.as_csv().encode()
    if media_type == PNG:
        from modalmotion.pictures.classification import evaluation_figure

        return png_of(evaluation_figure(result))
    return EvaluationAnswer.of(result, version).model_dump_json().encode()


def compare(
    models: tuple[Model, Model],
    versions: tuple[int, int],
    answers: tuple[Sequence[CaseAnswer], Sequence[CaseAnswer]],
    coverage: float,
) -> bytes:
    """Compare the answers of two models, as JSON."""
    first, second = (
        _evaluation(model, its, coverage) for model, its in zip(models, answers, strict=True)
    )
    return ComparisonAnswer.of(comparison_of(first, second), versions).model_dump_json().encode()


def held_out_table(model: Model, subjects: dict[str, str]) -> bytes:
    """Give the held-out answers of a model's cross-validation as a table; empty without one.

    Parameters
    ----------
    model : Path or str
    subjects : dict of str to str
        Of recordings, by id, as they are known now.
    """
    validation = loaded(model).cross_validation
    if validation is None:
        return b""
    return validation.as_csv({id_: ("", subject) for id_, subject in subjects.items()}).encode()


def held_out_ids(model: Model) -> list[str]:
    """Ids of the recordings that a model was trained on; none where its file does not say."""
    validation = loaded(model).cross_validation
    return [] if validation is None else list(validation.sequence_ids)


def _evaluation(model: Model, answers: Sequence[CaseAnswer], coverage: float) -> Evaluation:
    return evaluation_of(loaded(model), answers, coverage)
