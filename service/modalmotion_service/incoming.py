"""What may come in: how much, how slowly, and how many requests at once.

Pure ASGI, so that it holds whatever reads the body, and answers as a problem.
"""

from __future__ import annotations

import asyncio

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from modalmotion.errors import LimitError
from modalmotion_service.errors import BusyError, SlowClientError
from modalmotion_service.problems import problem_of


class BodyLimits:
    """Ends a request whose body is too large or comes too slowly.

    Parameters
    ----------
    app : ASGIApp
    body_bytes : int
    idle_seconds : float
        Longest pause between two pieces.
    upload_seconds : float
        Time for all of it.
    """

    def __init__(
        self, app: ASGIApp, body_bytes: int, idle_seconds: float, upload_seconds: float
    ) -> None:
        self.app = app
        self.body_bytes = body_bytes
        self.idle_seconds = idle_seconds
        self.upload_seconds = upload_seconds

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, watching what it receives."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        declared = dict(scope["headers"]).get(b"content-length", b"")
        if declared.isdigit() and int(declared) > self.body_bytes:
            await problem_of(self._too_large())(scope, receive, send)
            return
        loop = asyncio.get_running_loop()
        end = loop.time() + self.upload_seconds
        received, complete = 0, False

        async def watched() -> Message:
            nonlocal received, complete
            if complete:
                # What still comes is the news that the client has gone, whenever that is.
                return await receive()
            left = end - loop.time()
            try:
                # Not `wait_for`, which makes a task of each of the body's many pieces.
                async with asyncio.timeout(min(self.idle_seconds, max(left, 0))):
                    message = await receive()
            except TimeoutError:
                raise self._too_slow(received, left) from None
            received += len(message.get("body", b""))
            complete = not message.get("more_body", False)
            if received > self.body_bytes:
                raise self._too_large()
            return message

        await self.app(scope, watched, send)

    def _too_large(self) -> LimitError:
        return LimitError(
            f"The request body is larger than {self.body_bytes} bytes.",
            remedy="Send fewer frames, a coarser mesh, or float32.",
            limit="body_bytes",
            details={"most": self.body_bytes},
        )

    def _too_slow(self, received: int, left: float) -> SlowClientError:
        if left > self.idle_seconds:
            name, most, what = "idle_seconds", self.idle_seconds, "nothing more came for"
        else:
            name, most, what = "upload_seconds", self.upload_seconds, "it took longer than"
        return SlowClientError(
            f"The request body stopped after {received} bytes: {what} {most:g} s.",
            remedy="Send it again over a faster connection, or in a smaller form.",
            limit=name,
            details={"most": most},
        )


class WholeAnswers:
    """Ignores Range headers, as RFC 9110 (14.2) allows: answers come whole or not at all.

    A result is named by a tag and small beside its sequence; parts of files that are made for
    one answer and removed behind it could not be asked for again.

    Parameters
    ----------
    app : ASGIApp
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on without its ranges."""
        if scope["type"] == "http":
            kept = [(name, value) for name, value in scope["headers"] if name != b"range"]
            scope["headers"] = kept

        async def whole(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if "accept-ranges" in headers:
                    headers["Accept-Ranges"] = "none"
            await send(message)

        await self.app(scope, receive, whole)


class Concurrency:
    """Answers 429 while too many requests are under way; health checks always pass.

    Parameters
    ----------
    app : ASGIApp
    most : int
    """

    def __init__(self, app: ASGIApp, most: int) -> None:
        self.app = app
        self.most = most
        self._under_way = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on if there is room."""
        if scope["type"] != "http" or scope["path"].startswith("/health"):
            await self.app(scope, receive, send)
            return
        if self._under_way >= self.most:
            error = BusyError(
                f"{self.most} requests are under way, as many as are served at once.",
                remedy="Wait a second and send it again.",
                limit="concurrent_requests",
                details={"most": self.most},
            )
            await problem_of(error)(scope, receive, send)
            return
        self._under_way += 1
        try:
            await self.app(scope, receive, send)
        finally:
            self._under_way -= 1
