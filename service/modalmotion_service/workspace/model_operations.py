"""Operations on models and norms: made, tested, compared, asked."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from modalmotion.classification.evaluation import CaseAnswer
from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.store import ResultStore
from modalmotion_service.http.negotiation import CSV, JSON, PNG
from modalmotion_service.schemas.queries import (
    TRAINING,
    DeviationOptions,
    EvaluationOptions,
    NormOptions,
)
from modalmotion_service.work.tasks import classification
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.models import ChosenModel, Models
from modalmotion_service.workspace.operation import Outcome, Request, operation
from modalmotion_service.workspace.state import State
from modalmotion_service.workspace.training import Case, read_cases

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
            classification.measure, model.source, model.version, answers, coverage, media_type
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
            classification.compare,
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
        ids = await self._analysis.work(classification.held_out_ids, model.source)
        subjects = await asyncio.to_thread(self._subjects, ids)
        table = await self._analysis.work(classification.held_out_table, model.source, subjects)
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

        async def answered(case: Case) -> list[CaseAnswer]:
            answers = []
            for model in models:
                kept, _ = await self._models.classification(case.id, model, coverage)
                result = kept.result
                answers.append(
                    CaseAnswer(
                        name="",
                        sequence_id=case.id,
                        subject=case.subject or f"sequence {case.id}",
                        truth=case.label,
                        answer=result.label,
                        probabilities=tuple(result.probabilities.tolist()),
                        class_set=result.class_set,
                        flags=result.flags,
                    )
                )
            return answers

        def tell(done: int, total: int) -> None:
            report(_CLASSIFYING * done / total, f"sequence {done} of {total}")

        by_case = await self._analysis.each(cases, answered, tell)
        report(_CLASSIFYING, "figures")
        return [list(its) for its in zip(*by_case, strict=True)]


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


@operation(query=TRAINING, is_apart=True)
async def training(state: State, request: Request, report: Report) -> Outcome:
    """Train a model on the cases of a file."""
    file = request.file or ""
    cases = await asyncio.to_thread(read_cases, state.spool.at(file))
    options = request.query.options()
    record = await state.trainer.train(file, request.reference, options, cases, report)
    return Outcome(b"", link=f"/v1/models/{record.name}@{record.version}")


@operation(PNG)
async def model_view(state: State, request: Request, _: Report) -> Outcome:
    """Draw the card of a model."""
    model = await asyncio.to_thread(state.models.choose, request.reference)
    content = await asyncio.to_thread(state.models.describe, model)
    return Outcome(await state.models.draw(content), PNG)


@operation(CSV)
async def held_out(state: State, request: Request, _: Report) -> Outcome:
    """Give a model's answers to its training cases, each held out."""
    model = await asyncio.to_thread(state.models.choose, request.reference)
    name = f'attachment; filename="{model.name}-{model.version}.csv"'
    table = await Evaluations(state.store, state.analysis, state.models).held_out_table(model)
    return Outcome(table, CSV, headers={"Content-Disposition": name})


@operation(JSON, CSV, PNG, query=EvaluationOptions)
async def evaluation(state: State, request: Request, report: Report) -> Outcome:
    """Test a model, or two beside each other, on labelled sequences."""
    query = request.query
    model = await asyncio.to_thread(state.models.choose, request.reference)
    tests = Evaluations(state.store, state.analysis, state.models)
    if query.compare_with is not None:
        other = await asyncio.to_thread(state.models.choose, query.compare_with)
        body = await tests.compare((model, other), request.cases, query.coverage, report)
        return Outcome(body)
    media_type = request.media_type
    body = await tests.evaluate(model, request.cases, query.coverage, media_type, report)
    return Outcome(body, media_type)


@operation(query=NormOptions)
async def norm(state: State, request: Request, report: Report) -> Outcome:
    """Make a norm of stored controls."""
    query = request.query
    made = await state.norms.make(query.name, request.cases, query.modes, query.topology, report)
    return Outcome(b"", link=f"/v1/norms/{made.name}")


@operation(query=DeviationOptions)
async def deviations(state: State, request: Request, report: Report) -> Outcome:
    """Compare stored sequences with a norm, each, and from five on together."""
    level = request.query.level
    return Outcome(await state.norms.ask(request.cases, request.reference, level, report))
