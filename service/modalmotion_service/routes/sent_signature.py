"""The modal signature of an upload in one request; nothing is stored."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Depends, Request, Response

from modalmotion_service.http.negotiation import HDF5, JSON, NPZ, PNG, RAW, best_type
from modalmotion_service.http.query import described, header, read_once
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import (
    FileDependency,
    PreferenceDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import (
    ACCEPTED,
    BINARY,
    PREFER,
    PROBLEMS,
    UPLOAD_BODY,
)
from modalmotion_service.schemas import SignatureAnswer
from modalmotion_service.schemas.request_queries import TemplateQuery

router = APIRouter(prefix="/v1", tags=["signatures"], responses=PROBLEMS)

OFFERED: Final = (JSON, HDF5, NPZ, RAW, PNG)
"""Media types of a signature; RAW is its amplitudes as little-endian float32."""

_PARAMETERS: Final = [
    *described(TemplateQuery),
    header("accept", JSON, ", ".join(OFFERED)),
    header("prefer", "", PREFER),
]


@router.post(
    "/signature",
    response_model=SignatureAnswer,
    openapi_extra={**UPLOAD_BODY, "parameters": _PARAMETERS},
    responses={200: {"content": dict.fromkeys(OFFERED[1:], BINARY)}, **ACCEPTED},
)
async def signature(
    file: FileDependency,
    query: Annotated[TemplateQuery, Depends(read_once(TemplateQuery))],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
) -> Response:
    """Give the modal signature of a sequence that is sent with the request; nothing is stored.

    As JSON, the result's HDF5 file, npz, a picture, or the amplitudes alone as little-endian
    float32 (frame by frame, mode by mode, three directions), by `Accept`.
    """
    with file:
        media_type = best_type(request.headers.get("accept", JSON), OFFERED)
        body = {"query": query, "media_type": media_type}
        return await reply_or_job(
            *(state, preference, "sent-signature", body, file), headers={"Vary": "Accept"}
        )
