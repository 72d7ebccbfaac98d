"""The class of an upload's motion, nothing stored."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Query

from modalmotion_service.routes.parts.dependencies import FileDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import PROBLEMS, UPLOAD_BODY
from modalmotion_service.schemas import (
    ClassificationAnswer,
    ClassificationRequest,
    ReadingQuery,
    UploadClassificationAnswer,
)
from modalmotion_service.work.upload import Upload

router = APIRouter(prefix="/v1", tags=["classifications"], responses=PROBLEMS)


class ClassifyQuery(ReadingQuery, ClassificationRequest):
    """How to read the file, the model, and how sure its class set must be."""


@router.post("/classify", openapi_extra=UPLOAD_BODY)
async def classify(
    file: FileDependency, query: Annotated[ClassifyQuery, Query()], state: StateDependency
) -> UploadClassificationAnswer:
    """Classify a sequence's motion with a model; nothing is stored."""
    with file:
        model = await asyncio.to_thread(state.models.choose, query.model)
        sent = Upload(file.path, query.options(state.settings.read_limits, file.facts))
        result, reading = await state.models.classify(sent, model, query.coverage)
    answer = ClassificationAnswer.of(result, model.version, None)
    return UploadClassificationAnswer(**answer.model_dump(), reading=reading)
