"""Motion classes of a sequence."""

from __future__ import annotations

from fastapi import APIRouter, Response

from modalmotion_service.dependencies import AnalysisDependency, StoreDependency
from modalmotion_service.openapi_parts import PROBLEMS
from modalmotion_service.schemas import (
    ClassificationAnswer,
    ClassificationRequest,
    SequenceId,
)

router = APIRouter(prefix="/v1/sequences", tags=["classifications"], responses=PROBLEMS)


@router.post(
    "/{sequence_id}/classifications",
    status_code=201,
    responses={200: {"model": ClassificationAnswer, "description": "Known already."}},
)
def classification(
    sequence_id: SequenceId,
    store: StoreDependency,
    analysis: AnalysisDependency,
    response: Response,
    request: ClassificationRequest | None = None,
) -> ClassificationAnswer:
    """Ask a model for the class of a sequence's motion.

    201 when the answer is new, 200 when it was known.
    """
    asked = request or ClassificationRequest()
    result, path, is_new = analysis.classification(sequence_id, asked.model)
    response.status_code = 201 if is_new else 200
    return ClassificationAnswer.of(result, path.relative_to(store.root).as_posix())
