"""Connections of uvicorn, and heads of requests and answers.

Two programs that read a request in two ways can be played off against each other: a proxy that
lets through what it takes for one thing, and a service that does another. Such requests are
refused.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import re
import resource
from functools import partial
from typing import Any, Final, cast

import h11
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion_service.http.middleware import Middleware, with_headers
from modalmotion_service.http.problems import problem_of
from modalmotion_service.settings import Settings

# Open files that a process asks for, where it may have that many; and connections that uvicorn
# has asyncio accept in one go by default.
_MOST_FILES: Final = 65_536
_MOST_AT_ONCE: Final = 2048


def room_for_connections(most: int) -> tuple[int, int]:
    """Allow this process more open files, and return how many of them connections may take.

    Where a connection cannot be accepted for want of a file, no result can be read or stored
    either, and asyncio says so a thousand times a second.

    Returns
    -------
    connections : int
        At most `most`, and a third of all files: the rest is for stores and uploads, and for
    at_once : int
        that are accepted in one go, some times over before the first of them is counted.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, _MOST_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        soft = wanted
    files = _MOST_FILES if soft == resource.RLIM_INFINITY else soft
    return max(1, min(most, files // 3)), max(8, min(_MOST_AT_ONCE, files // 8))


def protocol_with_deadline(settings: Settings, most: int) -> type[H11Protocol]:
    """Make a protocol that closes connections whose client does not do its part.

    uvicorn limits how long an idle connection stays open after an answer, but neither how long a
    new one may be silent, or spell its headers out, nor how long an answer may wait for a client
    that does not read it.

    Parameters
    ----------
    settings : Settings
        `header_seconds` for a request line and headers to arrive, `idle_seconds` for a client to
        take the next 48 KiB of an answer.
    most : int
        Connections. Beyond them the one that has been silent longest is closed: a client that
        opens many and sends nothing keeps nobody else out.
    """
    quiet: dict[H11Protocol, None] = {}

    class Deadline(H11Protocol):
        _timer: asyncio.TimerHandle | None = None
        _unread: asyncio.TimerHandle | None = None
        _is_deaf = False

        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self._answer_in_full, self.app = self.app, self._answer

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            quiet[self] = None
            self._wait_for_headers()
            if len(self.connections) > most:
                longest = next(iter(quiet))
                del quiet[longest]
                longest.transport.abort()

        def pause_writing(self) -> None:
            super().pause_writing()
            # Abort, not close: closing waits until everything is read.
            self._unread = self.loop.call_later(settings.idle_seconds, self.transport.abort)

        def resume_writing(self) -> None:
            super().resume_writing()
            if self._unread is not None:
                self._unread.cancel()
                self._unread = None

        def data_received(self, data: bytes) -> None:
            if self._is_deaf:
                return
            super().data_received(data)
            if self._is_at_work():
                quiet.pop(self, None)
                self._stop_waiting()
            elif self._timer is None:
                # The next request on a connection that is kept open has begun.
                self._wait_for_headers()

        async def _answer(self, scope: Any, receive: Any, send: Any) -> None:
            cycle: RequestResponseCycle | None = self.cycle

            async def sent(message: Any) -> None:
                if cycle is not None and self._is_early():
                    if message["type"] == "http.response.start":
                        # Or the client's next request would be lost on this connection.
                        headers = [(n, v) for n, v in message["headers"] if n != b"connection"]
                        message = {**message, "headers": [*headers, (b"connection", b"close")]}
                    elif not message.get("more_body", False):
                        # Closed while something comes in, it would be reset, and the answer lost.
                        cycle.transport = cast("Any", _LeftOpen(self.transport))
                await send(message)

            await self._answer_in_full(scope, receive, sent)

        def _is_early(self) -> bool:
            return self.conn.their_state is h11.SEND_BODY and not self.transport.is_closing()

        def on_response_complete(self) -> None:
            # The latest of all.
            quiet[self] = None
            if self._is_early():
                # Answered before the body was there, as whoever has no key is: what still comes
                # is let in, so that the answer can be read, and not looked at. A chunk is 20 us.
                self._is_deaf = True
                self.transport.write_eof()
                self.flow.resume_reading()
                self._stop_waiting()
                self._wait_for_headers()
                return
            super().on_response_complete()

        def connection_lost(self, exc: Exception | None) -> None:
            quiet.pop(self, None)
            self._stop_waiting()
            if self._unread is not None:
                self._unread.cancel()
            super().connection_lost(exc)

        def send_400_response(self, msg: str) -> None:
            # uvicorn's own is plain text, and fails where an answer is under way already.
            if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
                body, headers = bad_request(msg)
                response = h11.Response(status_code=400, headers=headers, reason=b"Bad Request")
                self.transport.write(self.conn.send(response))
                # An answer to HEAD has no body, and h11 lets none pass.
                with contextlib.suppress(h11.LocalProtocolError):
                    self.transport.write(self.conn.send(h11.Data(data=body)))
            self.transport.close()

        def _wait_for_headers(self) -> None:
            self._timer = self.loop.call_later(settings.header_seconds, self._give_up)

        def _stop_waiting(self) -> None:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None

        def _give_up(self) -> None:
            self._timer = None
            if not self._is_at_work():
                self.transport.close()

        def _is_at_work(self) -> bool:
            cycle: RequestResponseCycle | None = self.cycle
            return cycle is not None and not cycle.response_complete

    return Deadline


class _LeftOpen:
    """A transport whose closing is left to the protocol.

    Parameters
    ----------
    transport : asyncio.Transport
    """

    def __init__(self, transport: Any) -> None:
        self.write, self.is_closing = transport.write, transport.is_closing

    def close(self) -> None:
        """Do nothing."""


def bad_request(message: str) -> tuple[bytes, list[tuple[bytes, bytes]]]:
    """Make body and headers of the answer to what is no HTTP request."""
    error = MalformedFileError(
        message, remedy="Send a request as RFC 9112 has it; its head is at most 64 KiB."
    )
    answer = problem_of(error)
    return bytes(answer.body), [*answer.raw_headers, (b"connection", b"close")]


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


class RequestHeadCheck(Middleware):
    """ASGI middleware that refuses requests which can be read in two ways.

    Parameters
    ----------
    app : ASGIApp
    """

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or refuse it."""
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


class SecurityHeaders(Middleware):
    """ASGI middleware that adds the headers; what a handler has set stays.

    Parameters
    ----------
    app : ASGIApp
    """

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""

        def guard(headers: MutableHeaders) -> None:
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
            if scope.get("scheme") == "https":
                headers.setdefault("Strict-Transport-Security", _HSTS)

        await self.app(scope, receive, with_headers(send, guard))


class HeadAsGet(Middleware):
    """ASGI middleware; the innermost one, so that all others know what was asked for."""

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
