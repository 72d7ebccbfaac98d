"""Operations on files that are sent, of which nothing is stored."""

from __future__ import annotations

import asyncio

from modalmotion_service.http.negotiation import (
    CSV,
    HDF5,
    JSON,
    NDJSON,
    NPZ,
    RAW,
    STREAM,
    VTKHDF,
    ZIP,
)
from modalmotion_service.http.timing import add_milliseconds, stage
from modalmotion_service.schemas.requests import (
    CLASS_OF_FILE,
    ENCODING_OF_FILE,
    SIGNATURE_OF_FILE,
    DecodingRequest,
)
from modalmotion_service.schemas.results import ClassificationAnswer, UploadClassificationAnswer
from modalmotion_service.work.tasks import codec
from modalmotion_service.workspace.batches import Batches
from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.operation import Outcome, Request, operation
from modalmotion_service.workspace.sequence_operations import encoded, sent
from modalmotion_service.workspace.signature_operations import SIGNATURE_TYPES
from modalmotion_service.workspace.state import State


@operation(*SIGNATURE_TYPES, query=SIGNATURE_OF_FILE)
async def sent_signature(state: State, request: Request, _: Report) -> Outcome:
    """Fit an upload."""
    with stage("worker"):
        body, milliseconds = await state.analysis.fit_upload(
            sent(state, request), request.query.parameters(), request.media_type
        )
    add_milliseconds(milliseconds)
    return Outcome(body, request.media_type)


@operation(JSON, NDJSON, HDF5, ZIP, CSV, query=SIGNATURE_OF_FILE)
async def sent_signatures(state: State, request: Request, report: Report) -> Outcome:
    """Fit each of many files that came in one request."""
    return await Batches(state).signatures(request, report)


@operation(query=CLASS_OF_FILE)
async def sent_classification(state: State, request: Request, _: Report) -> Outcome:
    """Classify the motion in an upload."""
    query = request.query
    model = await asyncio.to_thread(state.models.choose, query.model)
    result, reading = await state.models.classify(sent(state, request), model, query.coverage)
    named = ClassificationAnswer.of(result, model.version, None).model_dump()
    answer = UploadClassificationAnswer(**named, reading=reading)
    return Outcome(answer.model_dump_json().encode())


@operation(JSON, NDJSON, query=CLASS_OF_FILE)
async def sent_classifications(state: State, request: Request, report: Report) -> Outcome:
    """Classify the motion in each of many files that came in one request."""
    return await Batches(state).classifications(request, report)


@operation(STREAM, query=ENCODING_OF_FILE)
async def sent_encoding(state: State, request: Request, report: Report) -> Outcome:
    """Encode an upload."""
    return await encoded(
        state, codec.encode_upload, sent(state, request), request.query.target, report
    )


@operation(NPZ, VTKHDF, RAW, query=DecodingRequest)
async def decoding(state: State, request: Request, _: Report) -> Outcome:
    """Decode a stream, or a part of it."""
    frames, vertices = request.query.ranges()
    stream, limits = state.spool.at(request.file or ""), state.settings.read_limits
    with state.analysis.output() as output, stage("decode"):
        await state.analysis.work(
            codec.decode_upload, stream, limits, frames, vertices, request.media_type, output
        )
    return Outcome(output, request.media_type)
