"""The whole road as one job: images, points or contours are tracked, classified, reported on."""

from __future__ import annotations

import asyncio
import json
from typing import Annotated

from fastapi import Query, Request, Response

from modalmotion.facts import facts_as_json
from modalmotion_service.http.gate import note_ids
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.routes.parts.deferral import accepted
from modalmotion_service.routes.parts.dependencies import NamedFileDependency, StateDependency
from modalmotion_service.routes.parts.idempotency import IdempotencyKey, idempotent_answer
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, NAMED_UPLOAD_BODY, PROBLEMS
from modalmotion_service.routes.sequences import named
from modalmotion_service.routes.tracks import require_no_body
from modalmotion_service.schemas.tracks import TrackedReportQuery

router = JudgedRouter(
    prefix="/v1/reports", tags=["reports"], responses=PROBLEMS, route_class=JsonRoute
)


@router.post(
    "",
    status_code=202,
    response_class=Response,
    openapi_extra=NAMED_UPLOAD_BODY,
    responses=ACCEPTED,
)
async def report(
    file: NamedFileDependency,
    query: Annotated[TrackedReportQuery, Query()],
    state: StateDependency,
    request: Request,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Track a surface, name the class of its motion, and report on it: all as one job.

    What is sent, or named as images, is as for POST /v1/tracks; the track and the class are stored.
    The job's result is a zip with the report for people (PDF), for systems (FHIR) and for
    statistics (CSV), and a page on which the surface moves. It goes with the track.
    """
    query = named(query, file.names)

    async def make() -> Response:
        job: dict[str, object] = {
            "query": query.model_dump(mode="json"),
            "facts": facts_as_json(file.facts),
            "ids": [] if query.start is None else [query.start],
        }
        if query.images is None:
            job["file"] = file.path.name
            await asyncio.to_thread(file.make_durable)
        answer = accepted(await state.runner.start("tracked-report", job))
        file.is_left = query.images is None
        return answer

    with file:
        # Before anything is stored for a job.
        query.parameters(file.facts)
        note_ids(request, [name for name in (query.start, query.images) if name is not None])
        await state.tracks.start_path(query.start)
        if query.model is not None:
            await asyncio.to_thread(state.models.choose, query.model)
        if query.images is not None:
            await asyncio.to_thread(require_no_body, file)
            await asyncio.to_thread(state.store.images_record, query.images)
        fingerprint = (
            "POST /v1/reports",
            file.sha256,
            query.model_dump_json(),
            json.dumps(facts_as_json(file.facts)),
        )
        return await idempotent_answer(state.idempotency, idempotency_key, fingerprint, make)
