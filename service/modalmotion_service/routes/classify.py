"""The classes of the motion of uploads, nothing stored."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final

from fastapi import Query, Request, Response

from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import JSON, NDJSON, best_type
from modalmotion_service.http.query import header
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import (
    FilesDependency,
    PreferenceDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import (
    ACCEPTED,
    MANY_FILES_BODY,
    PROBLEMS,
    TEXT,
)
from modalmotion_service.schemas import UploadClassificationAnswer
from modalmotion_service.schemas.batches import ClassificationResults
from modalmotion_service.schemas.request_queries import ClassifyQuery
from modalmotion_service.work.upload import parts_as_json

router = JudgedRouter(prefix="/v1", tags=["classifications"], responses=PROBLEMS)


_PARAMETERS: Final = [header("accept", JSON, f"{JSON}; of many also {NDJSON}.")]


@router.post(
    "/classify",
    response_model=UploadClassificationAnswer | ClassificationResults,
    openapi_extra={**MANY_FILES_BODY, "parameters": _PARAMETERS},
    responses={200: {"content": {NDJSON: TEXT}}, **ACCEPTED},
)
async def classify_upload(
    file: FilesDependency,
    query: Annotated[ClassifyQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
) -> Response:
    """Classify a sequence's motion with a model; nothing is stored.

    Of many files, sent as parts named `files` of a form: a class or a problem for each, in their
    order, as JSON or a line of it each.
    """
    with file:
        await asyncio.to_thread(state.models.choose, query.model)
        if file.parts:
            media_type = best_type(request.headers.get("accept", JSON), (JSON, NDJSON))
            parts = parts_as_json(file.parts)
            body = {"query": query, "media_type": media_type, "parts": parts}
            return await reply_or_job(
                *(state, preference, "sent-classifications", body, file),
                headers={"Vary": "Accept"},
            )
        return await reply_or_job(state, preference, "sent-classification", {"query": query}, file)
