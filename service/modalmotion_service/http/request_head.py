"""Checks of a request's head that the rest of the service relies on.

Two programs that read a request in two ways can be played off against each other: a proxy that
lets through what it takes for one thing, and a service that does another. Such requests are
refused.
"""

from __future__ import annotations

import ipaddress
import re
from functools import partial
from typing import Final

from starlette.types import ASGIApp, Receive, Scope, Send

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion_service.http.problems import problem_of

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

    X-Forwarded-For holds what its sender likes, where a proxy passes it on unread.
    """
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return UNKNOWN_CLIENT
    # Made anew of its number: behind a % an IPv6 address may hold any text.
    return str(type(address)(int(address)))


def _fault(scope: Scope) -> InputError | None:
    if len(scope["method"]) > _LONGEST_METHOD:
        return _malformed(f"No method has more than {_LONGEST_METHOD} letters.")
    if _CONTROL.search(scope["path"]):
        return _malformed("The path holds a control character.")
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
