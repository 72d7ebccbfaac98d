"""A line of log, figures and a trace of every request, and its id.

Lines hold no patient data: the route's template in place of the path, and neither the query nor
anything of the body.
"""

from __future__ import annotations

import logging
import re
import secrets
import time
from contextlib import nullcontext
from typing import Final

import h11
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from modalmotion_service.access.scopes import principal_of
from modalmotion_service.http.gate import CLIENT_GONE, route_of
from modalmotion_service.http.middleware import Middleware
from modalmotion_service.http.observation import begin_stages, server_timing
from modalmotion_service.http.problems import internal_answer
from modalmotion_service.monitoring.metrics import Metrics
from modalmotion_service.monitoring.telemetry import Telemetry

logger = logging.getLogger("modalmotion_service.requests")

_REQUEST_ID: Final = re.compile(r"[A-Za-z0-9._-]{1,64}")
_METHODS: Final = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")


class Observation(Middleware):
    """ASGI middleware around everything else.

    Parameters
    ----------
    app : ASGIApp
    metrics : Metrics
    telemetry : Telemetry, optional
    """

    def __init__(self, app: ASGIApp, metrics: Metrics, telemetry: Telemetry | None) -> None:
        super().__init__(app)
        self.metrics = metrics
        self.telemetry = telemetry

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on; record it when it is answered."""
        header = Headers(scope=scope).get("x-request-id", "")
        request_id = header if _REQUEST_ID.fullmatch(header) else secrets.token_hex(8)
        scope["modalmotion.request_id"] = request_id
        # Clients may make up methods.
        method = scope["method"] if scope["method"] in _METHODS else "_OTHER"
        stages = begin_stages()
        start = time.perf_counter()
        status, n_received, n_sent, is_broken = 0, 0, 0, False

        async def received() -> Message:
            nonlocal n_received
            message = await receive()
            n_received += len(message.get("body", b""))
            return message

        async def observed(message: Message) -> None:
            nonlocal status, n_sent, is_broken
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers["X-Request-ID"] = request_id
                # Stages tell what was at hand already: only to who may see everything.
                principal = principal_of(scope)
                is_local = principal is not None and principal.key_id is None
                spent = 1e3 * (time.perf_counter() - start)
                headers["Server-Timing"] = server_timing(stages if is_local else {}, spent)
            n_sent += len(message.get("body", b""))
            try:
                if not is_broken:
                    await send(message)
            except h11.LocalProtocolError:
                # The rest of the request was not HTTP: uvicorn has said so and hung up.
                is_broken = True

        with self.telemetry.request(scope, method) if self.telemetry else nullcontext() as span:
            try:
                await self.app(scope, received, observed)
            except ClientDisconnect:
                status = status or CLIENT_GONE
            except Exception:
                logger.exception("request failed", extra={"request_id": request_id})
                if not status:
                    await internal_answer()(scope, receive, observed)
            finally:
                seconds, route = time.perf_counter() - start, route_of(scope)
                self.metrics.count(method, route or "other", status, seconds, n_received, n_sent)
                if self.telemetry:
                    self.telemetry.answered(span, method, route, status, stages)
                values = {"request_id": request_id, "method": method, "route": route}
                values |= {"status": status, "milliseconds": round(1e3 * seconds, 1)}
                logger.info("request", extra=values)
