"""Norms: made of stored controls, listed, described, deleted; and deviations from them."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final

from fastapi import Header, Query, Request, Response

from modalmotion.store import require_model_name
from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.gate import note_ids
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import HDF5, JSON, best_type
from modalmotion_service.routes.parts.deferral import accepted, reply_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.idempotency import IdempotencyKey, idempotent_answer
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS
from modalmotion_service.schemas import ModelName, SequenceId
from modalmotion_service.schemas.norms import (
    CohortDeviationAnswer,
    CohortRequest,
    DeviationAnswer,
    DeviationQuery,
    NormAnswer,
    NormList,
    NormRequest,
)
from modalmotion_service.workspace.training_set import cases_as_json, find_cases

router = JudgedRouter(prefix="/v1", tags=["norms"], responses=PROBLEMS, route_class=JsonRoute)

_DESCRIPTION: Final[dict[int | str, dict[str, object]]] = {200: {"content": {HDF5: BINARY}}}


@router.post("/norms", status_code=202, response_class=Response, responses=ACCEPTED)
async def make(
    request: NormRequest,
    http_request: Request,
    state: StateDependency,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Make a norm of stored recordings of people who are taken as usual, one of each.

    Always a job, whose result links to the norm. Missing signatures are fitted on the way.
    Subjects and covariates are those at the time of the request. The norm holds features of the
    controls, and stays when they are deleted.
    """

    async def start() -> Response:
        name = require_model_name(request.name)
        await asyncio.to_thread(state.norms.require_free, name)
        most = state.settings.max_query_ids
        cases = await asyncio.to_thread(find_cases, state.store, request.cases, most, "query_ids")
        note_ids(http_request, [case.id for case in cases])
        body = {
            "name": name,
            "cases": cases_as_json(cases),
            "modes": request.modes,
            "topology": request.topology,
        }
        return accepted(await state.runner.start("norm", body))

    fingerprint = ("POST norms", await asyncio.to_thread(request.model_dump_json))
    return await idempotent_answer(state.idempotency, idempotency_key, fingerprint, start)


@router.get("/norms")
async def list_norms(state: StateDependency) -> NormList:
    """List norms by name."""
    return NormList.of(await asyncio.to_thread(state.store.norms))


@router.get("/norms/{name}", response_model=NormAnswer, responses=_DESCRIPTION)
async def describe(
    name: ModelName,
    state: StateDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{JSON}, or {HDF5} for the norm.")] = JSON,
) -> Response:
    """Describe a norm; or give its file, which `modalmotion norm ask` reads."""
    media_type = best_type(accept, (JSON, HDF5))
    norm = await asyncio.to_thread(state.store.norm, name)
    tag = tag_of(norm.id, media_type)
    if is_known(request, tag):
        return not_modified(tag)
    headers = {"ETag": tag, "Vary": "Accept"}
    if media_type == HDF5:
        headers["Content-Disposition"] = f'attachment; filename="{name}.h5"'
        path = state.store.norm_path(name)
        return Response(await asyncio.to_thread(path.read_bytes), 200, headers, HDF5)
    return Response(NormAnswer.of(norm).model_dump_json(), 200, headers, JSON)


@router.delete("/norms/{name}", status_code=204)
async def delete(name: ModelName, state: StateDependency) -> None:
    """Delete a norm; its name is free again."""
    await asyncio.to_thread(state.store.delete_norm, name)


@router.post("/norms/{name}/deviations", response_model=CohortDeviationAnswer, responses=ACCEPTED)
async def cohort(
    name: ModelName,
    query: CohortRequest,
    http_request: Request,
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Compare stored sequences with a norm, each and together.

    Together they tell whether another machine, protocol or group of people stands behind them
    than behind the controls; then single p-values speak of that, and not of a person.
    """
    await asyncio.to_thread(state.store.norm_path, name)
    most = state.settings.max_query_ids
    cases = await asyncio.to_thread(find_cases, state.store, query.cases, most, "query_ids")
    note_ids(http_request, [case.id for case in cases])
    body = {"norm": name, "cases": cases_as_json(cases), "level": query.level}
    return await reply_or_job(state, preference, "cohort-deviation", body)


@router.post(
    "/sequences/{sequence_id}/deviations", response_model=DeviationAnswer, responses=ACCEPTED
)
async def deviations(
    sequence_id: SequenceId,
    query: Annotated[DeviationQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Tell how far a stored sequence lies from the controls of a norm, and in what.

    p-values are exact where the recording comes from where the controls come from; with too few
    controls for the level the answer is refused. Nothing is stored but its signature. No
    diagnosis.
    """
    state.store.sequence_record(sequence_id)
    await asyncio.to_thread(state.store.norm_path, query.norm)
    body = {"sequence_id": sequence_id, "query": query}
    return await reply_or_job(state, preference, "deviation", body)
