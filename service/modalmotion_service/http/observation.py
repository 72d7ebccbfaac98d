"""A line of log for every request, its id, and where its time went.

Lines hold no patient data: the route's template in place of the path, and neither the query nor
anything of the body.
"""

from __future__ import annotations

import logging
import re
import secrets
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

import h11
from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import Message, Receive, Scope, Send

from modalmotion_service.access.scopes import principal_of
from modalmotion_service.http.middleware import Middleware
from modalmotion_service.http.problems import internal_answer

_stages: ContextVar[dict[str, float] | None] = ContextVar("stages", default=None)


def begin_stages() -> dict[str, float]:
    """Start to collect milliseconds by stage in this context."""
    collected: dict[str, float] = {}
    _stages.set(collected)
    return collected


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Add the time of the block to a stage of the request it belongs to.

    What stages inside it take is theirs alone, so that all of them add up to what was waited.
    """
    start, before = time.perf_counter(), _sum()
    try:
        yield
    finally:
        spent = 1e3 * (time.perf_counter() - start)
        # Never below 0: stages of several tasks may run at the same time.
        add_milliseconds({name: max(0.0, spent - (_sum() - before))})


def _sum() -> float:
    return sum((_stages.get() or {}).values())


def add_milliseconds(milliseconds: Mapping[str, float]) -> None:
    """Add times measured elsewhere, such as by a worker."""
    collected = _stages.get()
    if collected is not None:
        for name, spent in milliseconds.items():
            collected[name] = collected.get(name, 0.0) + spent


def stages_so_far() -> dict[str, float]:
    """Give the milliseconds by stage of this context, so far."""
    return dict(_stages.get() or {})


def server_timing(spent_in: Mapping[str, float], total: float) -> str:
    """Write the header's value; `total` in milliseconds, and `other` of it in no stage."""
    other = max(0.0, total - sum(spent_in.values()))
    entries = [*spent_in.items(), *([("other", other)] if spent_in else []), ("total", total)]
    return ", ".join(f"{name};dur={spent:.1f}" for name, spent in entries)


logger = logging.getLogger("modalmotion_service.requests")

CLIENT_GONE: Final = 499
"""Status in logs and metrics where a client leaves before its request is complete."""

_REQUEST_ID: Final = re.compile(r"[A-Za-z0-9._-]{1,64}")


class Observation(Middleware):
    """ASGI middleware around everything else.

    Parameters
    ----------
    app : ASGIApp
    """

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on; log it when it is answered."""
        header = dict(scope["headers"]).get(b"x-request-id", b"").decode("latin-1")
        request_id = header if _REQUEST_ID.fullmatch(header) else secrets.token_hex(8)
        scope["modalmotion.request_id"] = request_id
        stages = begin_stages()
        start = time.perf_counter()
        status = 0
        broken = False

        async def observed(message: Message) -> None:
            nonlocal status, broken
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers["X-Request-ID"] = request_id
                spent = 1e3 * (time.perf_counter() - start)
                # Stages tell what was at hand already: only to who may see everything.
                principal = principal_of(scope)
                is_local = principal is not None and principal.key_id is None
                headers["Server-Timing"] = server_timing(stages if is_local else {}, spent)
            if broken:
                return
            try:
                await send(message)
            except h11.LocalProtocolError:
                # The rest of the request was not HTTP: uvicorn has said so and hung up.
                broken = True

        try:
            await self.app(scope, receive, observed)
        except ClientDisconnect:
            status = status or CLIENT_GONE
        except Exception:
            logger.exception("request failed", extra={"request_id": request_id})
            if not status:
                await internal_answer()(scope, receive, observed)
        finally:
            route = scope.get("route")
            logger.info(
                "request",
                extra={
                    "request_id": request_id,
                    # A client may make up a method of any length.
                    "method": scope["method"][:20],
                    "route": getattr(route, "path", None) or scope.get("modalmotion.route"),
                    "status": status,
                    "milliseconds": round(1e3 * (time.perf_counter() - start), 1),
                },
            )
