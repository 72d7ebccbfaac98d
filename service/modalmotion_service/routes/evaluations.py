"""Models tested on labelled sequences, and two of them compared."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Header, Request, Response

from modalmotion_service.http.gate import note_ids
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import CSV, JSON, PNG, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS
from modalmotion_service.schemas import LabelledSequence, ModelName, ModelVersion
from modalmotion_service.schemas.evaluations import (
    ComparisonAnswer,
    ComparisonRequest,
    EvaluationAnswer,
    EvaluationRequest,
)
from modalmotion_service.workspace.evaluations import require_known_classes
from modalmotion_service.workspace.model_versions import ChosenModel
from modalmotion_service.workspace.state import State
from modalmotion_service.workspace.training_set import Case, cases_as_json, labelled_cases

router = JudgedRouter(
    prefix="/v1/models", tags=["models"], responses=PROBLEMS, route_class=JsonRoute
)


@router.post(
    "/comparisons",
    response_model=ComparisonAnswer,
    responses=ACCEPTED,
)
async def compare(
    query: ComparisonRequest,
    request: Request,
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Compare two models on the same labelled sequences.

    Differences of accuracy, AUC, log loss and Brier score, with intervals from paired resamples of
    the subjects. Neither model should have been trained on them: notes say where one was.
    """
    models = [await asyncio.to_thread(state.models.choose, name) for name in query.models]
    cases = await asyncio.to_thread(_cases, state, models, query.cases, request)
    body = {
        "models": [f"{model.name}@{model.version}" for model in models],
        "cases": cases_as_json(cases),
        "coverage": query.coverage,
    }
    return await reply_or_job(state, preference, "comparison", body)


@router.post(
    "/{name}/versions/{version}/evaluations",
    response_model=EvaluationAnswer,
    responses={200: {"content": {CSV: BINARY, PNG: BINARY}}, **ACCEPTED},
)
async def evaluate(
    name: ModelName,
    version: ModelVersion,
    query: EvaluationRequest,
    request: Request,
    state: StateDependency,
    preference: PreferenceDependency,
    accept: Annotated[
        str, Header(description=f"{JSON}, {CSV} for the answers by case, or {PNG} for a picture.")
    ] = JSON,
) -> Response:
    """Test a version of a model on stored, labelled sequences.

    Missing classifications are made on the way and stored. Test on subjects that it was not trained
    on: a note says where it was.
    """
    media_type = best_type(accept, (JSON, CSV, PNG))
    model = await asyncio.to_thread(state.models.choose, f"{name}@{version}")
    cases = await asyncio.to_thread(_cases, state, [model], query.cases, request)
    body = {
        "model": f"{model.name}@{model.version}",
        "cases": cases_as_json(cases),
        "coverage": query.coverage,
        "media_type": media_type,
    }
    headers = {"Vary": "Accept"}
    return await reply_or_job(state, preference, "evaluation", body, headers=headers)


def _cases(
    state: State, models: list[ChosenModel], sequences: list[LabelledSequence], request: Request
) -> list[Case]:
    """Look the sequences up, and check that all models know their classes."""
    cases = labelled_cases(state.store, sequences, state.settings.max_query_ids, "query_ids")
    note_ids(request, [case.id for case in cases])
    for model in models:
        require_known_classes(cases, model.name, model.classes)
    return cases
