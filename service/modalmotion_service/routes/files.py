"""Signatures, classes and streams of files that are sent with the request; nothing is stored."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Depends, Response

from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import JSON, NDJSON, NPZ, RAW, STREAM, VTKHDF
from modalmotion_service.routes.asked import Asked, AskedAny, answers
from modalmotion_service.routes.uploads import Sent, receiving
from modalmotion_service.schemas.queries import DecodingRequest
from modalmotion_service.schemas.requests import CLASS_OF_FILE, ENCODING_OF_FILE, SIGNATURE_OF_FILE
from modalmotion_service.schemas.results import (
    ClassificationResults,
    SignatureResults,
    UploadClassificationAnswer,
)
from modalmotion_service.schemas.signatures import SignatureAnswer
from modalmotion_service.workspace import file_operations as operations
from modalmotion_service.workspace import models
from modalmotion_service.workspace.operation import Operation, Request
from modalmotion_service.workspace.signature_operations import SIGNATURE_TYPES

router = JudgedRouter(prefix="/v1", tags=["files"])


@router.post(
    "/signature",
    **answers(*SIGNATURE_TYPES, NDJSON, of=SignatureAnswer | SignatureResults),
)
async def sign_file(
    sent: Annotated[Sent, Depends(receiving(SIGNATURE_OF_FILE, takes_many=True))], asked: AskedAny
) -> Response:
    """Give the signature of a file; nothing is stored.

    As JSON, HDF5, npz, a table, a picture, or the amplitudes alone as little-endian float32 (frame
    by frame, mode by mode, three directions), by `Accept`.

    Of many files, sent as parts `files` of a form: a result or a problem for each, in their order,
    as JSON or a line of it each. A part `manifest`, a CSV table with the columns path, subject,
    label and facts, says those of each.
    """
    return await _answered(asked, sent, operations.sent_signature, operations.sent_signatures)


@router.post(
    "/classify",
    **answers(JSON, NDJSON, of=UploadClassificationAnswer | ClassificationResults),
)
async def classify_file(
    sent: Annotated[Sent, Depends(receiving(CLASS_OF_FILE, takes_many=True))], asked: AskedAny
) -> Response:
    """Name the class of the motion in a file; nothing is stored.

    Of many files, sent as parts `files` of a form: a class or a problem for each, in their order,
    as JSON or a line of it each.
    """
    with sent.file:
        await asyncio.to_thread(models.choose, asked.state, sent.query.model)
        return await _answered(
            asked, sent, operations.sent_classification, operations.sent_classifications
        )


@router.post("/encode", **answers(STREAM))
async def encode_file(
    sent: Annotated[Sent, Depends(receiving(ENCODING_OF_FILE))], asked: AskedAny
) -> Response:
    """Compress a file at an error you choose; nothing is stored.

    Size and errors of the stream are in the headers Encoded-...
    """
    return await _answered(asked, sent, operations.sent_encoding)


@router.post("/decode", **answers(NPZ, VTKHDF, RAW))
async def decode_file(
    sent: Annotated[Sent, Depends(receiving(DecodingRequest))], asked: AskedAny
) -> Response:
    """Decode a stream, or some of its frames and vertices; nothing is stored."""
    with sent.file:
        sent.query.ranges()
        return await _answered(asked, sent, operations.decoding)


async def _answered(
    asked: Asked, sent: Sent, of_one: Operation, of_many: Operation | None = None
) -> Response:
    with sent.file as file:
        what = of_many if of_many is not None and file.parts else of_one
        kind = asked.media_type(*what.media_types)
        return await asked.do(what, Request(query=sent.query, media_type=kind), file=file)
