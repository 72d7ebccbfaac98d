"""Evaluations of models on stored, labelled sequences."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence

from modalmotion.classification.evaluation import CaseAnswer
from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.mesh import Facts
from modalmotion.store import ResultStore
from modalmotion_service.work.tasks import evaluation
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.model_versions import ChosenModel
from modalmotion_service.workspace.models import Models
from modalmotion_service.workspace.training_set import Case

# Share of the progress that the classifications are counted as.
_CLASSIFYING = 0.95


class Evaluations:
    """Tests models; the classifications of the sequences are stored on the way.

    Parameters
    ----------
    store : ResultStore
    analysis : Analysis
    models : Models
    """

    def __init__(self, store: ResultStore, analysis: Analysis, models: Models) -> None:
        self._store = store
        self._analysis = analysis
        self._models = models

    async def evaluate(
        self,
        model: ChosenModel,
        cases: Sequence[Case],
        coverage: float,
        media_type: str,
        report: Report,
    ) -> bytes:
        """Test a model: JSON, a table of the cases, or a picture."""
        (answers,) = await self._answers((model,), cases, coverage, report)
        return await self._analysis.work(
            evaluation.measure, model.source, model.version, answers, coverage, media_type
        )

    async def compare(
        self,
        models: tuple[ChosenModel, ChosenModel],
        cases: Sequence[Case],
        coverage: float,
        report: Report,
    ) -> bytes:
        """Compare two models: JSON."""
        first, second = await self._answers(models, cases, coverage, report)
        return await self._analysis.work(
            evaluation.compare,
            (models[0].source, models[1].source),
            (models[0].version, models[1].version),
            (first, second),
            coverage,
        )

    async def held_out_table(self, model: ChosenModel) -> bytes:
        """Give the held-out answers of a model's cross-validation as CSV.

        Subjects are those stored with the sequences now; of a deleted one its number.

        Raises
        ------
        NotFoundError
            If the model has none.
        """
        ids = await self._analysis.work(evaluation.held_out_ids, model.source)
        subjects = await asyncio.to_thread(self._subjects, ids)
        table = await self._analysis.work(evaluation.held_out_table, model.source, subjects)
        if not table:
            raise NotFoundError(
                f"The model {model.name}@{model.version} has no held-out answers: it was not "
                "cross-validated, or its file does not hold them.",
                remedy="Train it again, or test it on other sequences: POST .../evaluations.",
            )
        return table

    def _subjects(self, ids: Sequence[str]) -> dict[str, str]:
        subjects = {}
        for sequence_id in ids:
            if self._store.has_sequence(sequence_id):
                subject = self._store.sequence_record(sequence_id).subject
                if subject is not None:
                    subjects[sequence_id] = subject
        return subjects

    async def _answers(
        self,
        models: Sequence[ChosenModel],
        cases: Sequence[Case],
        coverage: float,
        report: Report,
    ) -> list[list[CaseAnswer]]:
        """Answers of each model to each case."""
        answers: list[list[CaseAnswer | None]] = [[None] * len(cases) for _ in models]
        numbers = iter(range(len(cases)))
        done = 0

        async def take(numbers: Iterator[int]) -> None:
            nonlocal done
            for number in numbers:
                case = cases[number]
                stated = Facts(covariates=case.covariates)
                for model, its in zip(models, answers, strict=True):
                    kept, _ = await self._models.classification(case.id, model, coverage, stated)
                    result = kept.result
                    its[number] = CaseAnswer(
                        name="",
                        sequence_id=case.id,
                        subject=case.subject or f"sequence {case.id}",
                        truth=case.label,
                        answer=result.label,
                        probabilities=tuple(result.probabilities.tolist()),
                        class_set=result.class_set,
                        flags=result.flags,
                    )
                done += 1
                report(_CLASSIFYING * done / len(cases), f"sequence {done} of {len(cases)}")

        n_at_once = self._analysis.engine.n_workers
        takers = [asyncio.ensure_future(take(numbers)) for _ in range(n_at_once)]
        try:
            await asyncio.gather(*takers)
        finally:
            for taker in takers:
                taker.cancel()
            await asyncio.wait(takers)
        report(_CLASSIFYING, "figures")
        return [[answer for answer in its if answer is not None] for its in answers]


def require_known_classes(cases: Sequence[Case], name: str, classes: Sequence[str]) -> None:
    """Check that there are cases, and that a model knows the classes of all.

    Raises
    ------
    ParameterError
        If not; it names the sequences.
    """
    if not cases:
        raise ParameterError("There is no sequence to test on.", remedy="Name at least one.")
    unknown = [case for case in cases if case.label not in classes]
    if unknown:
        raise ParameterError(
            f"The model {name!r} does not know the class {unknown[0].label[:80]!r} of the sequence "
            f"{unknown[0].id[:12]}"
            + (f" and {len(unknown) - 1} more like it." if len(unknown) > 1 else "."),
            remedy=f"Name sequences of its classes: {', '.join(classes)}.",
            details={"sequence_ids": [case.id for case in unknown[:20]]},
        )
