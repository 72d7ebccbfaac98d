"""The modal signatures of uploads in one request; nothing is stored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from fastapi import Depends, Request, Response

from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import CSV, HDF5, JSON, NDJSON, ZIP, best_type
from modalmotion_service.http.preferences import Preference
from modalmotion_service.http.query import described, header, read_once
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import (
    LONGEST_PREFER,
    get_state,
    preference_of,
    receiving,
)
from modalmotion_service.routes.parts.openapi_parts import (
    ACCEPTED,
    BINARY,
    MANY_FILES_BODY,
    PREFER,
    PROBLEMS,
    TEXT,
)
from modalmotion_service.routes.parts.signature_types import SIGNATURE_CONTENT, SIGNATURE_TYPES
from modalmotion_service.schemas import SignatureAnswer
from modalmotion_service.schemas.batches import SignatureResults
from modalmotion_service.schemas.request_queries import TemplateQuery
from modalmotion_service.work.upload import parts_as_json
from modalmotion_service.workspace.spool import SpoolFile
from modalmotion_service.workspace.state import State

router = JudgedRouter(prefix="/v1", tags=["signatures"], responses=PROBLEMS)

_OF_MANY: Final = (JSON, NDJSON, HDF5, ZIP, CSV)

_PARAMETERS: Final = [
    header("prefer", "", PREFER, maxLength=LONGEST_PREFER),
    *described(TemplateQuery),
    header("accept", JSON, f"{', '.join(SIGNATURE_TYPES)}; of many {', '.join(_OF_MANY)}."),
]
_receive: Final = receiving(takes_many=True)
_query_of: Final = read_once(TemplateQuery)

_CONTENT: Final = {**SIGNATURE_CONTENT, NDJSON: TEXT, ZIP: BINARY}


@dataclass(frozen=True)
class _Sent:
    """All that the call depends on.

    Parameters
    ----------
    state : State
    file : SpoolFile
    query : TemplateQuery
    preference : Preference
    """

    state: State
    file: SpoolFile
    query: TemplateQuery
    preference: Preference


async def _sent(request: Request) -> _Sent:
    # One dependency and not five: what the framework does for each takes as long as what it is for.
    state = await get_state(request)
    file = await _receive(request, state)
    return _Sent(state, file, await _query_of(request), preference_of(request))


@router.post(
    "/signature",
    response_model=SignatureAnswer | SignatureResults,
    openapi_extra={**MANY_FILES_BODY, "parameters": _PARAMETERS},
    responses={200: {"content": _CONTENT}, **ACCEPTED},
)
async def sign_upload(sent: Annotated[_Sent, Depends(_sent)], request: Request) -> Response:
    """Give the modal signature of a sequence that is sent with the request; nothing is stored.

    As JSON, the result's HDF5 file, npz, a table, a picture, or the amplitudes alone as
    little-endian float32 (frame by frame, mode by mode, three directions), by `Accept`.

    Of many files, sent as parts named `files` of a form: a result or a problem for each, in their
    order, as JSON, a line of it each, a table with a row each, a zip with an HDF5 file each, or
    one HDF5 file with the trajectories of all, as `modalmotion store export` lays them out.
    """
    file, state, preference = sent.file, sent.state, sent.preference
    with file:
        if file.parts:
            return await _sign_many(sent, request)
        media_type = best_type(request.headers.get("accept", JSON), SIGNATURE_TYPES)
        body = {"query": sent.query, "media_type": media_type}
        return await reply_or_job(
            *(state, preference, "sent-signature", body, file), headers={"Vary": "Accept"}
        )


async def _sign_many(sent: _Sent, request: Request) -> Response:
    media_type = best_type(request.headers.get("accept", JSON), _OF_MANY)
    parts = parts_as_json(sent.file.parts)
    body = {"query": sent.query, "media_type": media_type, "parts": parts}
    return await reply_or_job(
        *(sent.state, sent.preference, "sent-signatures", body, sent.file),
        headers={"Vary": "Accept"},
    )
