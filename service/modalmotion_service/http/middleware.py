"""ASGI middleware: heads of requests and answers, limits on bodies and on requests at once.

Two programs that read a request in two ways can be played off against each other: a proxy that
lets through what it takes for one thing, and a service that does another. Such requests are
refused.
"""

import asyncio
import ipaddress
import re
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion_service.access.scopes import PROBES, principal_of
from modalmotion_service.errors import BusyError, SlowClientError
from modalmotion_service.http import gate, problems
from modalmotion_service.settings import Settings

API_VERSION: Final = "1.0.0"
"""Of the HTTP interface, apart from the package's: the first number rises where clients break, the
second where something is added, the third for words alone."""


class Middleware:
    """ASGI middleware for HTTP; other connections pass as they are.

    Parameters
    ----------
    app : ASGIApp
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a connection on."""
        passed = self.pass_on if scope["type"] == "http" else self.app
        await passed(scope, receive, send)

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        await self.app(scope, receive, send)


def with_headers(send: Send, change: Callable[[MutableHeaders], None]) -> Send:
    """Change the headers of an answer before they are sent."""

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            change(MutableHeaders(scope=message))
        await send(message)

    return sent


_LONGEST_METHOD: Final = 20
_MOST_FIELDS: Final = 200

_malformed: Final = partial(
    MalformedFileError, remedy="Send a request as RFC 9110 and RFC 9112 have it."
)

# A pattern of a route ends before a line break too: "/metrics%0a" would be /metrics to the router.
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f]")

UNKNOWN_CLIENT: Final = "unknown"
"""The client's address where a proxy that is believed gives none."""

_HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    # An answer is not a page: nothing in it runs, loads, or is shown inside another page.
    "Content-Security-Policy": "default-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    # Answers hold patients' data: neither a browser nor a proxy keeps them.
    "Cache-Control": "no-store",
    "API-Version": API_VERSION,
}
_HSTS: Final = "max-age=31536000; includeSubDomains"


class Heads(Middleware):
    """Refuses requests which can be read in two ways, and adds headers that guard answers.

    Headers that a handler has set stay. Ranges are ignored, as RFC 9110 (14.2) allows: a result is
    named by a tag and small beside its sequence, and a file made for one answer is removed after
    it, so that no second part could be fetched.

    Parameters
    ----------
    app : ASGIApp
    """

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or refuse it."""
        send = guarded(scope, send)
        if (error := _fault(scope)) is not None:
            answer = problems.problem_of(error)
            # Where it ends is not certain: what follows may not be a request.
            answer.headers["Connection"] = "close"
            await answer(scope, receive, send)
            return
        if scope.get("client") is not None:
            host, port = scope["client"]
            scope["client"] = (plain_address(host), port)
        scope["headers"] = [one for one in scope["headers"] if one[0] != b"range"]
        await self.app(scope, receive, send)


def guarded(scope: Scope, send: Send) -> Send:
    """Add the headers that every answer has."""

    def guard(headers: MutableHeaders) -> None:
        for name, value in _HEADERS.items():
            headers.setdefault(name, value)
        if scope.get("scheme") == "https":
            headers.setdefault("Strict-Transport-Security", _HSTS)
        if "accept-ranges" in headers:
            headers["Accept-Ranges"] = "none"

    return with_headers(send, guard)


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


class HeadAsGet(Middleware):
    """The innermost one, so that all others know what was asked for."""

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Have a HEAD routed as a GET, and send the head alone."""
        if scope["method"] != "HEAD":
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


class Prefix(Middleware):
    """The outermost one, so that all others see paths without it.

    A proxy may leave the prefix or take it away. `Location` and pages have it; links of bodies
    start below it, as the `servers` of the document say.

    Parameters
    ----------
    app : ASGIApp
    prefix : str
        Such as "/motion".
    """

    def __init__(self, app: ASGIApp, prefix: str) -> None:
        super().__init__(app)
        self.prefix = prefix

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on without the prefix, and its answer with it."""
        path: str = scope["path"]
        scope[PREFIX] = self.prefix
        if path == self.prefix or path.startswith(f"{self.prefix}/"):
            raw = scope.get("raw_path") or path.encode()
            scope = {
                **scope,
                "path": path.removeprefix(self.prefix) or "/",
                "raw_path": raw.removeprefix(self.prefix.encode()) or b"/",
            }

        def add(headers: MutableHeaders) -> None:
            if headers.get("location", "").startswith("/"):
                headers["location"] = self.prefix + headers["location"]

        await self.app(scope, receive, with_headers(send, add))


_IMAGES: Final = "/v1/images"

UPLOADS: Final = frozenset(
    (
        *("/v1/sequences", "/v1/signatures/{key}/dicom", "/v1/tracks", _IMAGES, "/v1/templates"),
        *("/v1/signature", "/v1/encode", "/v1/decode", "/v1/classify"),
    )
)
"""Routes whose body goes to a file as it comes. All others hold it in memory, as JSON."""

_TRAINING: Final = "/v1/models"
_MANY: Final = (
    *("/v1/signatures/query", "/v1/features", "/v1/models/{name}/evaluations"),
    *("/v1/norms", "/v1/norms/{name}/deviations"),
)
# Names, facts, the name of a model: landmarks and covariates are the longest.
_SMALL_BYTES: Final = 256_000
# An id in quotes, with its comma and a line of its own.
_BYTES_OF_ID: Final = 100

_SEND_LESS: Final = {
    "body_bytes": "Send fewer frames, a coarser mesh, or float32.",
    "image_body_bytes": "Send fewer frames, or a part of the images around the object.",
    "json_bytes": "Ask for less in one request.",
}


class BodyLimits(Middleware):
    """Ends a request whose body is too large or comes too slowly, whoever reads it.

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
        most = limits.max_body_bytes if route in UPLOADS else limits.max_json_bytes
        # Where there is no route, nothing is read. Of trainings the limit alone counts.
        if route not in UPLOADS | {None, _TRAINING}:
            of_ids = _BYTES_OF_ID * limits.max_query_ids if route in _MANY else 0
            most = min(most, _SMALL_BYTES + of_ids)
        return min((most, "json_bytes"), (limits.max_body_bytes, "body_bytes"))

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, watching what it receives."""
        most, name = self._most(gate.route_of(scope))
        too_large = LimitError(
            f"The request body is larger than {most} bytes.",
            remedy=_SEND_LESS[name],
            limit=name,
            details={"most": most},
        )
        declared = dict(scope["headers"]).get(b"content-length", b"")
        if declared.isdigit() and int(declared) > most:
            await problems.problem_of(too_large)(scope, receive, send)
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
                is_idle = left > self.settings.idle_seconds
                limit = "idle_seconds" if is_idle else "upload_seconds"
                seconds = getattr(self.settings, limit)
                raise SlowClientError(
                    f"The request body is too slow: {received} bytes, and {limit} ({seconds:g} s) "
                    "had passed.",
                    remedy="Send it again over a faster connection, or in a smaller form.",
                    limit=limit,
                    details={"most": seconds},
                ) from None
            received += len(message.get("body", b""))
            complete = not message.get("more_body", False)
            if received > most:
                raise too_large
            return message

        await self.app(scope, watched, send)


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
        # By owner, and of all under None.
        self.under_way: Counter[str | None] = Counter()

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on if there is room."""
        if scope["path"].startswith(PROBES):
            await self.app(scope, receive, send)
            return
        limits: dict[str | None, tuple[int, str]] = {None: (self.most, "concurrent_requests")}
        principal = principal_of(scope)
        if principal is not None and principal.key_id is not None:
            limits[principal.owner] = self.most_of_owner, "concurrent_requests_of_owner"
        for who, (most, limit) in limits.items():
            if self.under_way[who] >= most:
                busy = BusyError(
                    f"{most} requests are under way, as many as are served at once.",
                    remedy="Wait a second and send it again.",
                    limit=limit,
                    details={"most": most},
                )
                await problems.problem_of(busy)(scope, receive, send)
                return
        self.under_way.update(limits.keys())
        try:
            await self.app(scope, receive, send)
        finally:
            self.under_way.subtract(limits.keys())
