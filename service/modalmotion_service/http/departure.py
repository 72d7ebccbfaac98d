"""A client that has gone wants no answer: the work of its request is ended."""

from __future__ import annotations

import asyncio
from typing import Final

from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from modalmotion_service.http.admission import UPLOADS
from modalmotion_service.http.gate import route_of

# Besides what only reads: requests whose work is for their answer, or is done as well by the next.
_ENDED: Final = UPLOADS | {
    "/v1/signatures/query",
    "/v1/sequences/{sequence_id}/signatures",
    "/v1/sequences/{sequence_id}/tradeoff",
    "/v1/signatures/{key}/classifications",
}

# Most requests are answered sooner, and nobody looks after them.
_SECONDS: Final = 0.05


class Departure:
    """Ends a request that its client has left, from the moment on that its body is complete.

    Work that others wait for too goes on for them, and so does what has become a job.

    Parameters
    ----------
    app : ASGIApp
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and cancel it when its client leaves."""
        if scope["type"] != "http" or not _is_ended(scope):
            await self.app(scope, receive, send)
            return
        watch = _Watch(scope, receive)

        async def sent(message: Message) -> None:
            # Whoever leaves now leaves an answer, and no work.
            watch.end()
            await send(message)

        try:
            await self.app(scope, watch.receive, sent)
        except asyncio.CancelledError:
            if not watch.has_seen:
                raise
            watch.task.uncancel()
            raise ClientDisconnect from None
        finally:
            watch.end()


class _Watch:
    """Looks after the client of one request, whose body it passes on.

    Parameters
    ----------
    scope : Scope
    receive : Receive
    """

    def __init__(self, scope: Scope, receive: Receive) -> None:
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 (every request is one)
        self.task = task
        self.has_seen = False
        self._receive = receive
        self._is_over = False
        self._is_received = False
        self._kept: Message | None = None
        self._looking: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        if not _has_body(scope):
            # The handler may never ask for one.
            self._begin_soon()

    async def receive(self) -> Message:
        """Give the next message: of the body, then that the client has gone."""
        if self._looking is not None:
            if (kept := self._kept) is not None:
                self._kept = None
                return kept
            await asyncio.wait([self._looking])
            if not self._looking.cancelled():
                return {"type": "http.disconnect"}
        elif self._is_received:
            # Somebody else waits for the client to go.
            self.end()
        message = await self._receive()
        if message["type"] == "http.request" and not message.get("more_body", False):
            self._is_received = True
            self._begin_soon()
        return message

    def end(self) -> None:
        """Look no longer."""
        self._is_over = True
        if self._timer is not None:
            self._timer.cancel()
        if self._looking is not None:
            self._looking.cancel()

    def _begin_soon(self) -> None:
        if self._timer is None and not self._is_over:
            self._timer = asyncio.get_running_loop().call_later(_SECONDS, self._begin)

    def _begin(self) -> None:
        if not self._is_over:
            self._looking = asyncio.create_task(self._look())

    async def _look(self) -> None:
        message = await self._receive()
        if message["type"] == "http.request":
            # There was no body, and nobody has asked for it.
            self._kept = message
            message = await self._receive()
        if message["type"] == "http.disconnect" and not self._is_over:
            self.has_seen = True
            self.task.cancel()


def _is_ended(scope: Scope) -> bool:
    return scope["method"] in ("GET", "HEAD") or (
        scope["method"] == "POST" and route_of(scope) in _ENDED
    )


def _has_body(scope: Scope) -> bool:
    headers = dict(scope["headers"])
    return b"transfer-encoding" in headers or headers.get(b"content-length", b"0") != b"0"
