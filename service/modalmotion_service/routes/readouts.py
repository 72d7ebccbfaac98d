"""Clinical read-outs: volume over time and ejection fraction, from the signature."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Query, Request, Response

from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import CSV, JSON, PNG, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS, TEXT
from modalmotion_service.schemas import ReadoutsAnswer, SequenceId, SignatureQuery

router = JudgedRouter(prefix="/v1", tags=["read-outs"], responses=PROBLEMS)


@router.get(
    "/sequences/{sequence_id}/readouts",
    response_model=ReadoutsAnswer,
    responses={200: {"content": {PNG: BINARY, CSV: TEXT}}, **ACCEPTED},
)
async def readouts(
    sequence_id: SequenceId,
    query: Annotated[SignatureQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{JSON}, {PNG} or {CSV}.")] = JSON,
) -> Response:
    """Give the volume over time and the share of it that is lost, each with its bound.

    From the signature with these parameters; surfaces that enclose nothing are refused (422).
    The share is an ejection fraction where the fact `cavity` is stated or the surface is a cup,
    else a volume change.
    """
    media_type = best_type(accept, (JSON, PNG, CSV))
    parameters, facts = state.analysis.resolved(sequence_id, query.parameters())
    tag = tag_of(sequence_id, parameters.key, "readouts", media_type, facts.cavity)
    if is_known(request, tag):
        return not_modified(tag)
    body = {"sequence_id": sequence_id, "query": query, "media_type": media_type}
    headers = {"ETag": tag, "Vary": "Accept"}
    return await reply_or_job(state, preference, "readouts", body, headers=headers)
