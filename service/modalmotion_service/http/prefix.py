"""A path prefix that a proxy leaves in front of every path."""

from __future__ import annotations

from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as Connection

PREFIX: Final = "modalmotion.prefix"
"""Where a request has it."""


class Prefix:
    """ASGI middleware; the outermost one, so that all others see paths without it.

    A proxy may leave the prefix or take it away. `Location` and pages have it; links of bodies
    start below it, as the `servers` of the document say.

    Parameters
    ----------
    app : ASGIApp
    prefix : str
        Such as "/motion".
    """

    def __init__(self, app: ASGIApp, prefix: str) -> None:
        self.app = app
        self.prefix = prefix

    async def __call__(self, scope: Connection, receive: Receive, send: Send) -> None:
        """Pass a request on without the prefix, and its answer with it."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        path: str = scope["path"]
        scope[PREFIX] = self.prefix
        if path == self.prefix or path.startswith(f"{self.prefix}/"):
            raw = scope.get("raw_path") or path.encode()
            scope = {
                **scope,
                "path": path.removeprefix(self.prefix) or "/",
                "raw_path": raw.removeprefix(self.prefix.encode()) or b"/",
            }

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if headers.get("location", "").startswith("/"):
                    headers["location"] = self.prefix + headers["location"]
            await send(message)

        await self.app(scope, receive, sent)
