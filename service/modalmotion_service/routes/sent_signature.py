"""The modal signature of an upload in one request; nothing is stored."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Depends, Request, Response

from modalmotion_service.http.negotiation import HDF5, JSON, NPZ, PNG, RAW, best_type
from modalmotion_service.http.query import described, header, read_once
from modalmotion_service.routes.parts.dependencies import FileDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import BINARY, PROBLEMS, UPLOAD_BODY
from modalmotion_service.routes.templates import TemplateQuery
from modalmotion_service.schemas import SignatureAnswer
from modalmotion_service.work.upload import Upload

router = APIRouter(prefix="/v1", tags=["signatures"], responses=PROBLEMS)

OFFERED: Final = (JSON, HDF5, NPZ, RAW, PNG)
"""Media types of a signature; RAW is its amplitudes as little-endian float32."""

_PARAMETERS: Final = [*described(TemplateQuery), header("accept", JSON, ", ".join(OFFERED))]


@router.post(
    "/signature",
    response_model=SignatureAnswer,
    openapi_extra={**UPLOAD_BODY, "parameters": _PARAMETERS},
    responses={200: {"content": dict.fromkeys(OFFERED[1:], BINARY)}},
)
async def signature(
    file: FileDependency,
    query: Annotated[TemplateQuery, Depends(read_once(TemplateQuery))],
    state: StateDependency,
    request: Request,
) -> Response:
    """Give the modal signature of a sequence that is sent with the request; nothing is stored.

    As JSON, the result's HDF5 file, npz, a picture, or the amplitudes alone as little-endian
    float32 (frame by frame, mode by mode, three directions), by `Accept`.
    """
    with file:
        media_type = best_type(request.headers.get("accept", JSON), OFFERED)
        sent = Upload(file.path, query.options(state.settings.read_limits, file.facts))
        body = await state.analysis.signature_of_upload(sent, query.parameters(), media_type)
    return Response(body, media_type=media_type, headers={"Vary": "Accept"})
