"""Operations on models and norms: made, tested, compared, asked."""

from __future__ import annotations

import asyncio

from modalmotion_service.http.negotiation import CSV, JSON, PNG
from modalmotion_service.schemas.requests import (
    TRAINING,
    DeviationOptions,
    EvaluationOptions,
    NormOptions,
)
from modalmotion_service.workspace.evaluations import Evaluations
from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.operation import Outcome, Request, operation
from modalmotion_service.workspace.state import State
from modalmotion_service.workspace.training_set import read_cases


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
