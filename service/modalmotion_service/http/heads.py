"""Heads of requests and answers: checks, security headers, HEAD, a path prefix.

Two programs that read a request in two ways can be played off against each other: a proxy that
lets through what it takes for one thing, and a service that does another. Such requests are
refused.
"""

from __future__ import annotations

import ipaddress
import re
from functools import partial
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.types import Scope as Connection

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion_service.http.problems import problem_of

API_VERSION: Final = "1.0.0"
"""Of the HTTP interface, apart from the package's: the first number rises where clients break, the
second where something is added, the third for words alone."""


_LONGEST_METHOD: Final = 20
_MOST_FIELDS: Final = 200

_malformed: Final = partial(
    MalformedFileError, remedy="Send a request as RFC 9110 and RFC 9112 have it."
)

# A pattern of a route ends before a line break too: "/metrics%0a" would be /metrics to the router.
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f]")

UNKNOWN_CLIENT: Final = "unknown"
"""The client's address where a proxy that is believed gives none."""


class RequestHeadCheck:
    """ASGI middleware that refuses requests which can be read in two ways.

    Parameters
    ----------
    app : ASGIApp
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or refuse it."""
        if scope["type"] == "http":
            if (error := _fault(scope)) is not None:
                answer = problem_of(error)
                # Where it ends is not certain: what follows may not be a request.
                answer.headers["Connection"] = "close"
                await answer(scope, receive, send)
                return
            if scope.get("client") is not None:
                host, port = scope["client"]
                scope["client"] = (plain_address(host), port)
        await self.app(scope, receive, send)


def plain_address(text: str) -> str:
    """Write an address as it is counted and recorded.

    X-Forwarded-For contains what its sender likes, where a proxy passes it on unread.
    """
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return UNKNOWN_CLIENT
    # Made anew of its number: behind a % an IPv6 address may contain any text.
    return str(type(address)(int(address)))


def _fault(scope: Scope) -> InputError | None:
    if len(scope["method"]) > _LONGEST_METHOD:
        return _malformed(f"No method has more than {_LONGEST_METHOD} letters.")
    if _CONTROL.search(scope["path"]):
        return _malformed("The path contains a control character.")
    if (n_fields := scope["query_string"].count(b"&") + 1) > _MOST_FIELDS:
        # Each unknown one is an error of its own: nine thousand stopped everybody for 0.3 s.
        return LimitError(
            f"The query has {n_fields} fields; at most {_MOST_FIELDS} are read.",
            remedy="Send each parameter once, as /docs names it.",
            limit="query_fields",
            details={"value": n_fields, "most": _MOST_FIELDS},
        )
    names = {name for name, _ in scope["headers"]}
    if b"content-length" in names and b"transfer-encoding" in names:
        # RFC 9112, 6.1: a server may reject it, and it is how requests are smuggled.
        return _malformed("The request has a Content-Length and a Transfer-Encoding.")
    return None


# An answer is not a page: nothing in it runs, loads, or is shown inside another page.
_NOTHING: Final = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"

_HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": _NOTHING,
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    # Answers hold patients' data: neither a browser nor a proxy keeps them.
    "Cache-Control": "no-store",
    "API-Version": API_VERSION,
}
_HSTS: Final = "max-age=31536000; includeSubDomains"


class SecurityHeaders:
    """ASGI middleware that adds the headers; what a handler has set stays.

    Parameters
    ----------
    app : ASGIApp
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
                if scope.get("scheme") == "https":
                    headers.setdefault("Strict-Transport-Security", _HSTS)
            await send(message)

        await self.app(scope, receive, guarded)


class HeadAsGet:
    """ASGI middleware; the innermost one, so that all others know what was asked for."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Connection, receive: Receive, send: Send) -> None:
        """Have a HEAD routed as a GET, and send the head alone."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self.app(scope, receive, send)
            return

        async def send_head(message: Message) -> None:
            is_body = message["type"] == "http.response.body"
            await send({**message, "body": b""} if is_body else message)

        scope["method"] = "GET"
        try:
            await self.app(scope, receive, send_head)
        finally:
            scope["method"] = "HEAD"


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
