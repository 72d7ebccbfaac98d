"""The modal signatures of uploads in one request; nothing is stored."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import Depends, Request, Response

from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import CSV, HDF5, JSON, NDJSON, ZIP, best_type
from modalmotion_service.http.preferences import Preference
from modalmotion_service.http.query import described, header, read_once
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import (
    FilesDependency,
    PreferenceDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import (
    ACCEPTED,
    BINARY,
    MANY_FILES_BODY,
    PROBLEMS,
    TEXT,
)
from modalmotion_service.routes.parts.signature_types import SIGNATURE_CONTENT, SIGNATURE_TYPES
from modalmotion_service.schemas import SignatureAnswer
from modalmotion_service.schemas.batches import SignatureResults
from modalmotion_service.schemas.request_queries import TemplateQuery
from modalmotion_service.work.part import parts_as_json
from modalmotion_service.workspace.spool import SpoolFile
from modalmotion_service.workspace.state import State

router = JudgedRouter(prefix="/v1", tags=["signatures"], responses=PROBLEMS)

_OF_MANY: Final = (JSON, NDJSON, HDF5, ZIP, CSV)

_PARAMETERS: Final = [
    *described(TemplateQuery),
    header("accept", JSON, f"{', '.join(SIGNATURE_TYPES)}; of many {', '.join(_OF_MANY)}."),
]
_CONTENT: Final = {**SIGNATURE_CONTENT, NDJSON: TEXT, ZIP: BINARY}


@router.post(
    "/signature",
    response_model=SignatureAnswer | SignatureResults,
    openapi_extra={**MANY_FILES_BODY, "parameters": _PARAMETERS},
    responses={200: {"content": _CONTENT}, **ACCEPTED},
)
async def sign_upload(
    file: FilesDependency,
    query: Annotated[TemplateQuery, Depends(read_once(TemplateQuery))],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
) -> Response:
    """Give the modal signature of a sequence that is sent with the request; nothing is stored.

    As JSON, the result's HDF5 file, npz, a table, a picture, or the amplitudes alone as
    little-endian float32 (frame by frame, mode by mode, three directions), by `Accept`.

    Of many files, sent as parts named `files` of a form: a result or a problem for each, in their
    order, as JSON, a line of it each, a table with a row each, a zip with an HDF5 file each, or
    one HDF5 file with the trajectories of all, as `modalmotion store export` lays them out.
    """
    with file:
        if file.parts:
            return await _sign_many(file, query, state, preference, request)
        media_type = best_type(request.headers.get("accept", JSON), SIGNATURE_TYPES)
        body = {"query": query, "media_type": media_type}
        return await reply_or_job(
            *(state, preference, "sent-signature", body, file), headers={"Vary": "Accept"}
        )


async def _sign_many(
    file: SpoolFile,
    query: TemplateQuery,
    state: State,
    preference: Preference,
    request: Request,
) -> Response:
    media_type = best_type(request.headers.get("accept", JSON), _OF_MANY)
    parts = parts_as_json(file.parts)
    body = {"query": query, "media_type": media_type, "parts": parts}
    return await reply_or_job(
        *(state, preference, "sent-signatures", body, file), headers={"Vary": "Accept"}
    )
