"""Compressed streams: encode and decode, stored or not."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from fastapi import APIRouter, Header, Query, Response
from pydantic import BaseModel, ConfigDict, Field

from modalmotion.errors import ParameterError
from modalmotion_service.http.negotiation import NPZ, RAW, STREAM, VTKHDF, best_type
from modalmotion_service.routes.parts.deferral import result_or_job
from modalmotion_service.routes.parts.dependencies import (
    FileDependency,
    PreferenceDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS, UPLOAD_BODY
from modalmotion_service.routes.parts.temporary_file import temporary_file
from modalmotion_service.schemas import EncodedAnswer, EncodingTarget, ReadingQuery, SequenceId
from modalmotion_service.work.upload import Upload

router = APIRouter(prefix="/v1", tags=["codec"], responses=PROBLEMS)

_STREAM_ANSWER: Final = {
    "description": "The stream; what was measured on it stands in the headers Encoded-...",
    "content": {STREAM: BINARY},
}


class EncodeQuery(ReadingQuery, EncodingTarget):
    """How to read the file, and at what error to encode the sequence in it."""


@router.post(
    "/encode",
    response_class=Response,
    openapi_extra=UPLOAD_BODY,
    responses={200: _STREAM_ANSWER},
)
async def encode(
    file: FileDependency, query: Annotated[EncodeQuery, Query()], state: StateDependency
) -> Response:
    """Compress a sequence at an error you choose; nothing is stored."""
    target = EncodingTarget(**query.model_dump(include=set(EncodingTarget.model_fields)))
    with file:
        sent = Upload(file.path, query.options(state.settings.read_limits, file.facts))
        path, answer = await state.analysis.encoded(sent, target)
    return _stream(path, answer)


class DecodeQuery(BaseModel):
    """Which frames of a stream to decode."""

    model_config = ConfigDict(extra="forbid")

    first: int | None = Field(None, ge=0, description="First frame; the stream's own by default.")
    stop: int | None = Field(None, ge=1, description="Frame after the last.")


@router.post(
    "/decode",
    response_class=Response,
    openapi_extra=UPLOAD_BODY,
    responses={
        200: {
            "description": "The sequence.",
            "content": {NPZ: BINARY, VTKHDF: BINARY, RAW: BINARY},
        }
    },
)
async def decode(
    file: FileDependency,
    query: Annotated[DecodeQuery, Query()],
    state: StateDependency,
    accept: Annotated[str, Header(description=f"{NPZ}, {VTKHDF} or {RAW} (float32).")] = NPZ,
) -> Response:
    """Decode a stream, or some of its frames; nothing is stored."""
    with file:
        media_type = best_type(accept, (NPZ, VTKHDF, RAW))
        if (query.first is None) != (query.stop is None):
            raise ParameterError(
                "Only one end of the range of frames is given.", remedy="Give first and stop."
            )
        frames = None
        if query.first is not None and query.stop is not None:
            frames = range(query.first, query.stop)
        limits = state.settings.read_limits
        path = await state.analysis.decoded(file.path, limits, frames, media_type)
    return temporary_file(path, media_type)


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
    """Give a kept sequence as a compressed stream."""
    state.store.sequence_path(sequence_id)
    request = {"sequence_id": sequence_id, "target": target.model_dump(mode="json")}
    work = state.analysis.encoded(sequence_id, target)
    found = await result_or_job(state, preference, "encoding", request, work)
    return found if isinstance(found, Response) else _stream(*found)


def _stream(path: Path, answer: EncodedAnswer) -> Response:
    return temporary_file(path, STREAM, headers=answer.headers)
