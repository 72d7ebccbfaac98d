"""Motion classes of a sequence."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter, Response

from modalmotion.store import Job
from modalmotion_service.deferral import accepted, result_or_job
from modalmotion_service.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.once import IdempotencyKey, once
from modalmotion_service.openapi_parts import ACCEPTED, PROBLEMS
from modalmotion_service.schemas import (
    ClassificationAnswer,
    ClassificationList,
    ClassificationRequest,
    SequenceId,
)

router = APIRouter(prefix="/v1/sequences", tags=["classifications"], responses=PROBLEMS)


@router.post(
    "/{sequence_id}/classifications",
    status_code=201,
    response_model=ClassificationAnswer,
    responses={
        200: {"model": ClassificationAnswer, "description": "Known already."},
        **ACCEPTED,
    },
)
async def classify(
    sequence_id: SequenceId,
    state: StateDependency,
    preference: PreferenceDependency,
    request: ClassificationRequest | None = None,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Ask a model for the class of a sequence's motion.

    201 when the answer is new, 200 when it was known.
    """
    model = (request or ClassificationRequest()).model
    state.store.sequence_record(sequence_id)

    async def make() -> Response:
        found = await result_or_job(
            state,
            preference,
            "classification",
            {"sequence_id": sequence_id, "model": model},
            state.analysis.classification(sequence_id, model),
        )
        if isinstance(found, Job):
            return accepted(found)
        result, path, is_new = found
        answer = ClassificationAnswer.of(result, state.analysis.within_store(path))
        return Response(
            answer.model_dump_json(), 201 if is_new else 200, media_type="application/json"
        )

    fingerprint = ("POST classifications", sequence_id, model)
    return await once(state.store, idempotency_key, fingerprint, make)


@router.get("/{sequence_id}/classifications")
async def list_classifications(
    sequence_id: SequenceId, state: StateDependency
) -> ClassificationList:
    """List what models have said of a sequence."""

    def read() -> list[ClassificationAnswer]:
        answers = []
        for model_id, key in state.store.classifications(sequence_id):
            result = state.store.classification(sequence_id, model_id, key)
            path = state.store.classification_path(sequence_id, model_id, key)
            answers.append(ClassificationAnswer.of(result, state.analysis.within_store(path)))
        return answers

    return ClassificationList(classifications=await asyncio.to_thread(read))
