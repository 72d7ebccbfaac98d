"""Compressed streams: encode and decode, stored or not."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import Header, Query, Response

from modalmotion.errors import ParameterError
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import NPZ, RAW, STREAM, VTKHDF, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import (
    FileDependency,
    PreferenceDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS, UPLOAD_BODY
from modalmotion_service.schemas import EncodingTarget, SequenceId
from modalmotion_service.schemas.request_queries import DecodeQuery, EncodeQuery

router = JudgedRouter(prefix="/v1", tags=["codec"], responses=PROBLEMS)

_STREAM_ANSWER: Final = {
    "description": "The stream; its size and errors are in the headers Encoded-...",
    "content": {STREAM: BINARY},
}


@router.post(
    "/encode",
    response_class=Response,
    openapi_extra=UPLOAD_BODY,
    responses={200: _STREAM_ANSWER, **ACCEPTED},
)
async def encode(
    file: FileDependency,
    query: Annotated[EncodeQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Compress a sequence at an error you choose; nothing is stored."""
    with file:
        return await reply_or_job(state, preference, "sent-encoding", {"query": query}, file)


@router.post(
    "/decode",
    response_class=Response,
    openapi_extra=UPLOAD_BODY,
    responses={
        200: {
            "description": "The sequence.",
            "content": {NPZ: BINARY, VTKHDF: BINARY, RAW: BINARY},
        },
        **ACCEPTED,
    },
)
async def decode(
    file: FileDependency,
    query: Annotated[DecodeQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    accept: Annotated[str, Header(description=f"{NPZ}, {VTKHDF} or {RAW} (float32).")] = NPZ,
) -> Response:
    """Decode a stream, or some of its frames and vertices; nothing is stored."""
    with file:
        media_type = best_type(accept, (NPZ, VTKHDF, RAW))
        if (query.first is None) != (query.stop is None):
            raise ParameterError(
                "The range of frames has only one end.", remedy="Give first and stop."
            )
        if (query.first_vertex is None) != (query.stop_vertex is None):
            raise ParameterError(
                "The range of vertices has only one end.",
                remedy="Give first_vertex and stop_vertex.",
            )
        request = {"query": query, "media_type": media_type}
        return await reply_or_job(state, preference, "decoding", request, file)


@router.get(
    "/sequences/{sequence_id}/encoded",
    response_class=Response,
    responses={200: _STREAM_ANSWER, **ACCEPTED},
)
async def encoded(
    sequence_id: SequenceId,
    target: Annotated[EncodingTarget, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Give a stored sequence as a compressed stream."""
    state.store.sequence_path(sequence_id)
    request = {"sequence_id": sequence_id, "target": target}
    return await reply_or_job(state, preference, "encoding", request)
