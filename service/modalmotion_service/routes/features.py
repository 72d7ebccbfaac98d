"""Features of many sequences as a table."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final

from fastapi import Header, Request, Response

from modalmotion_service.http.gate import note_ids
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import CSV, JSON, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, PROBLEMS
from modalmotion_service.schemas import FeaturesAnswer, FeaturesRequest
from modalmotion_service.workspace.training_set import cases_as_json, find_cases

router = JudgedRouter(prefix="/v1", tags=["features"], responses=PROBLEMS, route_class=JsonRoute)

_TABLE: Final = {"schema": {"type": "string"}}


@router.post(
    "/features",
    response_model=FeaturesAnswer,
    responses={200: {"content": {CSV: _TABLE}}, **ACCEPTED},
)
async def features(
    query: FeaturesRequest,
    http_request: Request,
    state: StateDependency,
    preference: PreferenceDependency,
    accept: Annotated[str, Header(description=f"{JSON} or {CSV}.")] = JSON,
) -> Response:
    """Give the features of stored sequences as a table: a line for each, as JSON or CSV.

    They do not depend on pose, unit, start or sampling. Missing signatures are fitted on the way,
    in modes that all the sequences share. Nothing is stored besides.
    """
    media_type = best_type(accept, (JSON, CSV))
    most = state.settings.max_query_ids
    cases = await asyncio.to_thread(find_cases, state.store, query.cases, most, "query_ids")
    note_ids(http_request, [case.id for case in cases])
    body = {
        "cases": cases_as_json(cases),
        "options": query.options(),
        "on_error": query.on_error,
        "media_type": media_type,
    }
    return await reply_or_job(state, preference, "features", body, headers={"Vary": "Accept"})
