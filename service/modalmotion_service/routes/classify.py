"""The class of an upload's motion, nothing stored."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Query, Response

from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import (
    FileDependency,
    PreferenceDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, PROBLEMS, UPLOAD_BODY
from modalmotion_service.schemas import UploadClassificationAnswer
from modalmotion_service.schemas.request_queries import ClassifyQuery

router = APIRouter(prefix="/v1", tags=["classifications"], responses=PROBLEMS)


@router.post(
    "/classify",
    response_model=UploadClassificationAnswer,
    openapi_extra=UPLOAD_BODY,
    responses=ACCEPTED,
)
async def classify_upload(
    file: FileDependency,
    query: Annotated[ClassifyQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Classify a sequence's motion with a model; nothing is stored."""
    with file:
        await asyncio.to_thread(state.models.choose, query.model)
        return await reply_or_job(state, preference, "sent-classification", {"query": query}, file)
