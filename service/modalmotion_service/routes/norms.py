"""Norms: made of stored controls, listed, described, asked, deleted."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Depends, Query, Response

from modalmotion.store import require_model_name
from modalmotion_service.http.judged_router import JudgedRouter, body_of
from modalmotion_service.http.negotiation import HDF5, JSON
from modalmotion_service.routes.asked import AskedAny, AskedNow, IdempotencyKey, page_of
from modalmotion_service.routes.described import answers, body
from modalmotion_service.schemas.from_core import ModelName, Paging
from modalmotion_service.schemas.models import (
    CohortDeviationAnswer,
    NormAnswer,
    NormLink,
    NormPageAnswer,
)
from modalmotion_service.schemas.requests import (
    DeviationOptions,
    DeviationRequest,
    NormOptions,
    NormRequest,
)
from modalmotion_service.workspace import model_operations as operations
from modalmotion_service.workspace.operation import Request
from modalmotion_service.workspace.training_set import find_cases

router = JudgedRouter(prefix="/v1/norms", tags=["norms"])


@router.post("", **answers(status=202), **body(NormRequest))
async def make_norm(
    wanted: Annotated[NormRequest, Depends(body_of(NormRequest))],
    asked: AskedNow,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Make a norm of stored recordings of people who are taken as usual, one of each.

    Always a job, whose result links to the norm. Missing signatures are fitted on the way.
    Subjects and covariates are those at the time of the request. The norm holds features of the
    controls, and stays when they are deleted.
    """
    state = asked.state

    async def make() -> Response:
        await asyncio.to_thread(state.norms.require_free, require_model_name(wanted.name))
        most = state.settings.max_query_ids
        cases = await asyncio.to_thread(find_cases, state.store, wanted.cases, most, "query_ids")
        asked.note(*(case.id for case in cases))
        options = wanted.without_cases(NormOptions)
        ids = tuple(case.id for case in cases)
        return await asked.start(
            operations.norm, Request(query=options, cases=tuple(cases), ids=ids)
        )

    said = Request(query=wanted)
    return await asked.once(idempotency_key, operations.norm, said, None, make)


@router.get("", response_model=NormPageAnswer)
async def list_norms(query: Annotated[Paging, Query()], asked: AskedNow) -> NormPageAnswer:
    """List norms by name, a page at a time."""
    names = await asyncio.to_thread(asked.store.norms)
    page, cursor = page_of(list(names), query.limit, query.cursor)
    links = [NormLink(name=name, links={"self": f"/v1/norms/{name}"}) for name in page]
    return NormPageAnswer(norms=links, cursor=cursor)


@router.get("/{name}", **answers(JSON, HDF5, of=NormAnswer, waits=False))
async def describe_norm(name: ModelName, asked: AskedNow) -> Response:
    """Describe a norm; or give its file, which `modalmotion norm ask` reads."""
    kind = asked.media_type(JSON, HDF5)
    norm = await asyncio.to_thread(asked.store.norm, name)
    tag = asked.tagged(norm.id, kind)
    if (known := asked.knows(tag)) is not None:
        return known
    headers = {"ETag": tag, "Vary": "Accept"}
    if kind == HDF5:
        headers["Content-Disposition"] = f'attachment; filename="{name}.h5"'
        path = asked.store.norm_path(name)
        return Response(await asyncio.to_thread(path.read_bytes), 200, headers, HDF5)
    return Response(NormAnswer.of(norm).model_dump_json(), 200, headers, JSON)


@router.delete("/{name}", status_code=204)
async def delete_norm(name: ModelName, asked: AskedNow) -> None:
    """Delete a norm; its name is free again."""
    await asyncio.to_thread(asked.store.delete_norm, name)


@router.post("/{name}/deviations", **answers(of=CohortDeviationAnswer), **body(DeviationRequest))
async def compare_with_norm(
    name: ModelName,
    wanted: Annotated[DeviationRequest, Depends(body_of(DeviationRequest))],
    asked: AskedAny,
) -> Response:
    """Compare stored sequences with a norm, each, and from five on together.

    p-values are exact where the recordings come from where the controls come from; with too few
    controls for the level the answer is refused. Together they tell whether another machine,
    protocol or group of people stands behind them than behind the controls; then single p-values
    speak of that, and not of a person. No diagnosis. Missing signatures are stored on the way.
    """
    await asyncio.to_thread(asked.store.norm_path, name)
    most = asked.state.settings.max_query_ids
    cases = await asyncio.to_thread(find_cases, asked.store, wanted.cases, most, "query_ids")
    asked.note(*(case.id for case in cases))
    request = Request(
        query=wanted.without_cases(DeviationOptions),
        ids=tuple(case.id for case in cases),
        cases=tuple(cases),
        reference=name,
    )
    return await asked.do(operations.deviations, request)
