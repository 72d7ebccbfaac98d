"""Requests with an Idempotency-Key: sent twice, done once."""

from __future__ import annotations

import asyncio
import base64
import contextlib
from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import Header
from starlette.responses import Response

from modalmotion.errors import StoreError
from modalmotion_service.errors import ConflictError, IdempotencyMismatchError
from modalmotion_service.http.conditional import tag_of
from modalmotion_service.workspace.idempotency import IdempotencyKeys

IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=128,
        description="A request sent again with the same key is answered as the first time.",
    ),
]

_KEPT_HEADERS = ("content-type", "location", "etag", "preference-applied")


async def idempotent_answer(
    keys: IdempotencyKeys,
    key: str | None,
    fingerprint: tuple[str, ...],
    make: Callable[[], Awaitable[Response]],
) -> Response:
    """Make an answer, or repeat the one made for the same key.

    Parameters
    ----------
    keys : IdempotencyKeys
    key : str or None
        None makes the answer anew.
    fingerprint : tuple of str
        Everything that the answer depends on.
    make : async function
        Makes the answer. An error is not remembered: it had no effect.

    Raises
    ------
    IdempotencyMismatchError
        If the key came before with another request.
    ConflictError
        If the first request is still under way.
    """
    if key is None:
        return await make()
    mark = tag_of(*fingerprint)
    known = await asyncio.to_thread(keys.claim, key, mark)
    if known is None:
        try:
            answer = await make()
        except BaseException:
            # What went wrong first is what the client is told.
            with contextlib.suppress(StoreError):
                await asyncio.to_thread(keys.release, key)
            raise
        response = {
            "body": base64.b64encode(bytes(answer.body)).decode("ascii"),
            "headers": {n: v for n, v in answer.headers.items() if n in _KEPT_HEADERS},
        }
        await asyncio.to_thread(keys.complete, key, answer.status_code, response)
        return answer
    if known.fingerprint != mark:
        raise IdempotencyMismatchError(
            "This Idempotency-Key came before with another request.",
            remedy="Use a new key for every new request.",
        )
    if known.status is None:
        raise ConflictError(
            "The first request with this Idempotency-Key is still under way.",
            remedy="Wait a second and send it again.",
        )
    return Response(
        base64.b64decode(known.response["body"]),
        status_code=known.status,
        headers={**known.response["headers"], "Idempotency-Replayed": "true"},
    )
