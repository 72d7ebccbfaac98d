"""The trade of accuracy for numbers and time on a kept sequence."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Query, Request, Response

from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import JSON, PNG, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS
from modalmotion_service.schemas import SequenceId, TradeoffAnswer
from modalmotion_service.schemas.tradeoff_query import TradeoffQuery

router = JudgedRouter(prefix="/v1", tags=["signatures"], responses=PROBLEMS)


@router.get(
    "/sequences/{sequence_id}/tradeoff",
    response_model=TradeoffAnswer,
    responses={200: {"content": {PNG: BINARY}}, **ACCEPTED},
)
async def tradeoff(
    sequence_id: SequenceId,
    query: Annotated[TradeoffQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{JSON}, or {PNG} for a picture.")] = JSON,
) -> Response:
    """Give cost and error of each choice of modes, and mark the requested one.

    Modes, harmonics, components and topologies at once; nothing is stored.
    """
    media_type = best_type(accept, (JSON, PNG))
    parameters = query.parameters()
    landmarks = state.store.sequence_record(sequence_id).facts.landmarks
    only = "" if query.components is None else query.components.value
    # Times differ from one answer to the next, so that the tag is a weak one.
    places = (repr(landmarks),) if landmarks else ()
    tag = tag_of(sequence_id, parameters.key, media_type, str(query.front_modes), only, *places)
    if is_known(request, tag):
        return not_modified(f"W/{tag}")
    body = {"sequence_id": sequence_id, "query": query, "media_type": media_type}
    headers = {"ETag": f"W/{tag}", "Vary": "Accept"}
    return await reply_or_job(state, preference, "tradeoff", body, headers=headers)
