"""Reports for hospital systems, for statistics and for people."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response

from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.negotiation import CSV, FHIR, PDF, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS, TEXT
from modalmotion_service.schemas import SequenceId
from modalmotion_service.schemas.request_queries import ReportQuery

router = APIRouter(prefix="/v1", tags=["reports"], responses=PROBLEMS)


@router.get(
    "/sequences/{sequence_id}/report",
    response_class=Response,
    responses={
        200: {
            "description": "The report.",
            "content": {FHIR: {"schema": {"type": "object"}}, PDF: BINARY, CSV: TEXT},
        },
        **ACCEPTED,
    },
)
async def report(
    sequence_id: SequenceId,
    query: Annotated[ReportQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{FHIR}, {PDF} or {CSV}.")] = FHIR,
) -> Response:
    """Report on a sequence: a FHIR R4 bundle, a page for people, or a row for each frame.

    Volumes and the share that is lost with their intervals, amplitudes, error, and the kept
    classification of the model that is named. Everything is preliminary; no subject is named.
    The same result is the same bytes: its time is that at which the sequence was kept.
    """
    media_type = best_type(accept, (FHIR, PDF, CSV))
    parameters, facts = state.analysis.resolved(sequence_id, query.parameters())
    known = None
    if query.model is not None:
        known = await asyncio.to_thread(state.models.known_classification, sequence_id, query.model)
    said = "" if known is None else f"{known.result.model_id} {known.path.name}"
    tag = tag_of(sequence_id, parameters.key, "report", media_type, repr(facts), said)
    if is_known(request, tag):
        return not_modified(tag)
    body = {"sequence_id": sequence_id, "query": query, "media_type": media_type}
    headers = {"ETag": tag, "Vary": "Accept"}
    return await reply_or_job(state, preference, "report", body, headers=headers)
