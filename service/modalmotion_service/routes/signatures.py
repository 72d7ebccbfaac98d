"""Modal signatures of a sequence."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header, Query, Response
from starlette.responses import FileResponse

from modalmotion_service.dependencies import AnalysisDependency, StoreDependency
from modalmotion_service.negotiation import HDF5, JSON, best_type
from modalmotion_service.openapi_parts import PROBLEMS
from modalmotion_service.schemas import SequenceId, SignatureAnswer, SignatureQuery

router = APIRouter(prefix="/v1/sequences", tags=["signatures"], responses=PROBLEMS)


@router.get(
    "/{sequence_id}/signature",
    response_model=SignatureAnswer,
    responses={200: {"content": {HDF5: {"schema": {"type": "string", "format": "binary"}}}}},
)
def signature(
    sequence_id: SequenceId,
    query: Annotated[SignatureQuery, Query()],
    store: StoreDependency,
    analysis: AnalysisDependency,
    accept: Annotated[str, Header(description=f"{JSON} or {HDF5}.")] = JSON,
) -> Response | SignatureAnswer:
    """Give the modal signature: amplitudes, error, spectrum, energy and where it is kept.

    JSON or the result's HDF5 file, by `Accept`.
    """
    media_type = best_type(accept, (JSON, HDF5))
    result, path = analysis.signature(sequence_id, query.parameters())
    if media_type == HDF5:
        return FileResponse(path, media_type=HDF5, filename=f"{sequence_id[:12]}-signature.h5")
    answer = SignatureAnswer.of(result, path.relative_to(store.root).as_posix())
    # The model is valid by construction: written out once, not checked a second time.
    return Response(answer.model_dump_json(), media_type=JSON)
