"""A limit on request bodies that holds whatever reads them, and answers as a problem."""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from modalmotion.errors import LimitError
from modalmotion_service.problems import problem_of


class BodyLimit:
    """ASGI middleware that ends a request once its body exceeds a number of bytes.

    Parameters
    ----------
    app : ASGIApp
    max_body_bytes : int
    """

    def __init__(self, app: ASGIApp, max_body_bytes: int) -> None:
        self.app = app
        self.max_body_bytes = max_body_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, counting what it receives."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        declared = dict(scope["headers"]).get(b"content-length", b"")
        if declared.isdigit() and int(declared) > self.max_body_bytes:
            await problem_of(self._error())(scope, receive, send)
            return
        received = 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > self.max_body_bytes:
                raise self._error()
            return message

        await self.app(scope, counted, send)

    def _error(self) -> LimitError:
        return LimitError(
            f"The request body is larger than {self.max_body_bytes} bytes.",
            remedy="Send fewer frames, a coarser mesh, or float32.",
            limit="max_body_bytes",
            details={"most": self.max_body_bytes},
        )
