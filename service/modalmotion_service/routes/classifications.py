"""Motion classes of a sequence."""

from __future__ import annotations

import asyncio

from fastapi import Response

from modalmotion.facts import Facts
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.routes.parts.deferral import result_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.idempotency import IdempotencyKey, idempotent_answer
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, PROBLEMS
from modalmotion_service.schemas import (
    ClassificationAnswer,
    ClassificationList,
    ClassificationRequest,
    SequenceId,
)
from modalmotion_service.workspace.models import KeptClassification
from modalmotion_service.workspace.state import State

router = JudgedRouter(
    prefix="/v1/sequences", tags=["classifications"], responses=PROBLEMS, route_class=JsonRoute
)


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
    """Classify a sequence's motion with a model.

    201 when the answer is new, 200 when it was known.
    """
    state.store.sequence_record(sequence_id)
    parameters = request or ClassificationRequest()
    stated = Facts(covariates=parameters.covariates or {})

    async def make() -> Response:
        model = await asyncio.to_thread(state.models.choose_for, parameters.model, sequence_id)
        result = await result_or_job(
            state,
            preference,
            "classification",
            # By its version: a newer one may exist when the job is resumed.
            {
                "sequence_id": sequence_id,
                "model": f"{model.name}@{model.version}",
                "coverage": parameters.coverage,
                "covariates": dict(stated.covariates),
            },
            state.models.classification(sequence_id, model, parameters.coverage, stated),
        )
        if isinstance(result, Response):
            return result
        classification, is_new = result
        return Response(
            _answer(classification, state).model_dump_json(),
            201 if is_new else 200,
            headers={"Location": f"/v1/sequences/{sequence_id}/classifications"},
            media_type="application/json",
        )

    fingerprint = ("POST classifications", sequence_id, parameters.model_dump_json())
    return await idempotent_answer(state.idempotency, idempotency_key, fingerprint, make)


@router.get("/{sequence_id}/classifications")
async def list_classifications(
    sequence_id: SequenceId, state: StateDependency
) -> ClassificationList:
    """List the classifications of a sequence."""

    def read() -> list[ClassificationAnswer]:
        return [_answer(one, state) for one in state.models.classifications(sequence_id)]

    return ClassificationList(classifications=await asyncio.to_thread(read))


def _answer(classification: KeptClassification, state: State) -> ClassificationAnswer:
    file = state.analysis.within_store(classification.path)
    return ClassificationAnswer.of(classification.result, classification.version, file)
