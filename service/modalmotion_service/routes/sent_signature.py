"""The modal signature of an upload in one request; nothing is stored."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Depends, Request, Response

from modalmotion_service.http.negotiation import JSON, best_type
from modalmotion_service.http.query import described, header, read_once
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import (
    FileDependency,
    PreferenceDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, PROBLEMS, UPLOAD_BODY
from modalmotion_service.routes.parts.signature_types import SIGNATURE_CONTENT, SIGNATURE_TYPES
from modalmotion_service.schemas import SignatureAnswer
from modalmotion_service.schemas.request_queries import TemplateQuery

router = APIRouter(prefix="/v1", tags=["signatures"], responses=PROBLEMS)

_PARAMETERS: Final = [
    *described(TemplateQuery),
    header("accept", JSON, ", ".join(SIGNATURE_TYPES)),
]


@router.post(
    "/signature",
    response_model=SignatureAnswer,
    openapi_extra={**UPLOAD_BODY, "parameters": _PARAMETERS},
    responses={200: {"content": SIGNATURE_CONTENT}, **ACCEPTED},
)
async def sign_upload(
    file: FileDependency,
    query: Annotated[TemplateQuery, Depends(read_once(TemplateQuery))],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
) -> Response:
    """Give the modal signature of a sequence that is sent with the request; nothing is stored.

    As JSON, the result's HDF5 file, npz, a table, a picture, or the amplitudes alone as
    little-endian float32 (frame by frame, mode by mode, three directions), by `Accept`.
    """
    with file:
        media_type = best_type(request.headers.get("accept", JSON), SIGNATURE_TYPES)
        body = {"query": query, "media_type": media_type}
        return await reply_or_job(
            *(state, preference, "sent-signature", body, file), headers={"Vary": "Accept"}
        )
