"""Requests that end early: by limits on size, speed and number, or because their client left.

Pure ASGI, so that limits hold for every reader of the body; the answer is a problem.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from modalmotion.errors import LimitError
from modalmotion_service.access.scopes import PROBES, principal_of
from modalmotion_service.errors import BusyError, SlowClientError
from modalmotion_service.http.gate import route_of
from modalmotion_service.http.middleware import Middleware, with_headers
from modalmotion_service.http.problems import problem_of
from modalmotion_service.settings import Settings

UPLOADS: Final = frozenset(
    (
        "/v1/sequences",
        "/v1/signatures/{key}/dicom",
        "/v1/tracks",
        "/v1/images",
        "/v1/signature",
        "/v1/templates",
        "/v1/encode",
        "/v1/decode",
        "/v1/classify",
    )
)
"""Routes whose body goes to a file as it comes. All others hold it in memory, as JSON."""

_IMAGES: Final = "/v1/images"
_TRAINING: Final = "/v1/models"
_MANY: Final = (
    "/v1/signatures/query",
    "/v1/norms",
    "/v1/norms/{name}/deviations",
    "/v1/models/{name}/evaluations",
    "/v1/features",
)
# Names, facts, the name of a model: landmarks and covariates are the longest.
_SMALL_BYTES: Final = 256_000
# An id in quotes, with its comma and a line of its own.
_BYTES_OF_ID: Final = 100


class BodyLimits(Middleware):
    """Ends a request whose body is too large or comes too slowly.

    Parameters
    ----------
    app : ASGIApp
    settings : Settings
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        super().__init__(app)
        self.settings = settings

    def _most(self, route: str | None) -> tuple[int, str]:
        """Give the most bytes of a body, and the name of that limit."""
        limits = self.settings
        if route == _IMAGES:
            return limits.max_image_body_bytes, "image_body_bytes"
        of_json = limits.max_body_bytes if route in UPLOADS else limits.max_json_bytes
        # Where there is no route, nothing is read. Of trainings the limit alone counts.
        if route not in UPLOADS | {None, _TRAINING}:
            of_ids = _BYTES_OF_ID * limits.max_query_ids if route in _MANY else 0
            of_json = min(of_json, _SMALL_BYTES + of_ids)
        if of_json < limits.max_body_bytes:
            return of_json, "json_bytes"
        return limits.max_body_bytes, "body_bytes"

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, watching what it receives."""
        most, name = self._most(route_of(scope))
        declared = dict(scope["headers"]).get(b"content-length", b"")
        if declared.isdigit() and int(declared) > most:
            await problem_of(_too_large(most, name))(scope, receive, send)
            return
        loop = asyncio.get_running_loop()
        end = loop.time() + self.settings.upload_seconds
        received, complete = 0, False

        async def watched() -> Message:
            nonlocal received, complete
            if complete:
                # All that still comes is the news that the client has gone.
                return await receive()
            left = end - loop.time()
            try:
                # Not `wait_for`, which makes a task of each of the body's many pieces.
                async with asyncio.timeout(min(self.settings.idle_seconds, max(left, 0))):
                    message = await receive()
            except TimeoutError:
                raise self._too_slow(received, left) from None
            received += len(message.get("body", b""))
            complete = not message.get("more_body", False)
            if received > most:
                raise _too_large(most, name)
            return message

        await self.app(scope, watched, send)

    def _too_slow(self, received: int, left: float) -> SlowClientError:
        if left > self.settings.idle_seconds:
            name, most, what = "idle_seconds", self.settings.idle_seconds, "nothing more came for"
        else:
            name, most, what = "upload_seconds", self.settings.upload_seconds, "it took longer than"
        return SlowClientError(
            f"The request body stopped after {received} bytes: {what} {most:g} s.",
            remedy="Send it again over a faster connection, or in a smaller form.",
            limit=name,
            details={"most": most},
        )


def _too_large(most: int, name: str) -> LimitError:
    remedies = {
        "body_bytes": "Send fewer frames, a coarser mesh, or float32.",
        "image_body_bytes": "Send fewer frames, or a part of the images around the object.",
        "json_bytes": "Ask for less in one request.",
    }
    return LimitError(
        f"The request body is larger than {most} bytes.",
        remedy=remedies[name],
        limit=name,
        details={"most": most},
    )


class WholeAnswers(Middleware):
    """Ignores Range headers, as RFC 9110 (14.2) allows: answers come whole or not at all.

    A result is named by a tag and small beside its sequence; a file made for one answer is removed
    after it, so that no second part could be fetched.

    Parameters
    ----------
    app : ASGIApp
    """

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on without its ranges."""
        scope["headers"] = [one for one in scope["headers"] if one[0] != b"range"]

        def whole(headers: MutableHeaders) -> None:
            if "accept-ranges" in headers:
                headers["Accept-Ranges"] = "none"

        await self.app(scope, receive, with_headers(send, whole))


class Concurrency(Middleware):
    """Answers 429 while too many requests are under way; health checks always pass.

    Where keys tell owners apart, one alone never has them all: however many slow uploads come
    with their keys, others are answered.

    Parameters
    ----------
    app : ASGIApp
    settings : Settings
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        super().__init__(app)
        self.most = settings.max_concurrent_requests
        self.most_of_owner = settings.max_concurrent_requests_of_owner
        self._under_way = 0
        self._of_owner: Counter[str] = Counter()

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on if there is room."""
        if scope["path"].startswith(PROBES):
            await self.app(scope, receive, send)
            return
        principal = principal_of(scope)
        owner = None if principal is None or principal.key_id is None else principal.owner
        if self._under_way >= self.most:
            await _busy("concurrent_requests", self.most)(scope, receive, send)
            return
        if owner is not None and self._of_owner[owner] >= self.most_of_owner:
            busy = _busy("concurrent_requests_of_owner", self.most_of_owner)
            await busy(scope, receive, send)
            return
        self._under_way += 1
        if owner is not None:
            self._of_owner[owner] += 1
        try:
            await self.app(scope, receive, send)
        finally:
            self._under_way -= 1
            if owner is not None:
                self._of_owner[owner] -= 1


def _busy(limit: str, most: int) -> Response:
    return problem_of(
        BusyError(
            f"{most} requests are under way, as many as are served at once.",
            remedy="Wait a second and send it again.",
            limit=limit,
            details={"most": most},
        )
    )


# Besides what only reads: requests whose work is for their answer, or is done as well by the next.
_ENDED: Final = UPLOADS | {
    "/v1/signatures/query",
    "/v1/sequences/{sequence_id}/signatures",
    "/v1/sequences/{sequence_id}/tradeoff",
    "/v1/signatures/{key}/classifications",
}

# Most requests are answered sooner, and nobody looks after them.
_LOOK_SECONDS: Final = 0.05


class Departure(Middleware):
    """Ends a request that its client has left, from the moment on that its body is complete.

    Work that others wait for too goes on for them, and so does what has become a job.

    Parameters
    ----------
    app : ASGIApp
    """

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and cancel it when its client leaves."""
        if not _is_ended(scope):
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
            self._timer = asyncio.get_running_loop().call_later(_LOOK_SECONDS, self._begin)

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
