"""A line of log, figures and a trace of every request, and its id.

Neither lines nor traces hold patient data: the route's template in place of the path, the method,
the status and milliseconds by stage, and neither the query nor anything of a body, no owner, key,
sequence or job, and no text of an error.
"""

import logging
import re
import secrets
import time
from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from importlib.metadata import version
from typing import Any, Final

import h11
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from modalmotion.errors import needs_extra
from modalmotion_service.access.scopes import principal_of
from modalmotion_service.http import gate, problems
from modalmotion_service.http.middleware import Middleware, guarded
from modalmotion_service.http.observation import begin_stages, server_timing
from modalmotion_service.monitoring.metrics import Metrics

logger = logging.getLogger("modalmotion_service.requests")

_REQUEST_ID: Final = re.compile(r"[A-Za-z0-9._-]{1,64}")
_METHODS: Final = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")


class Telemetry:
    """A tracer, and what it exports to.

    Parameters
    ----------
    processor : SpanProcessor, optional
        One that sends to the collector which `OTEL_EXPORTER_OTLP_ENDPOINT` names, by default.

    Raises
    ------
    MissingExtraError
        If a package is absent.
    """

    def __init__(self, processor: Any = None) -> None:
        with needs_extra("telemetry"):
            from opentelemetry import trace
            from opentelemetry.sdk.resources import Resource
            from opentelemetry.sdk.trace import TracerProvider
            from opentelemetry.trace.propagation.tracecontext import (
                TraceContextTextMapPropagator,
            )

            if processor is None:
                from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
                from opentelemetry.sdk.trace.export import BatchSpanProcessor

                processor = BatchSpanProcessor(OTLPSpanExporter())
        about = {"service.name": "modalmotion", "service.version": version("modalmotion")}
        # Of this service alone: nothing global is set.
        self._provider = TracerProvider(resource=Resource.create(about), shutdown_on_exit=False)
        self._provider.add_span_processor(processor)
        self._tracer = self._provider.get_tracer("modalmotion_service")
        self._propagator = TraceContextTextMapPropagator()
        self._trace = trace

    def close(self) -> None:
        """Send what has not been sent."""
        self._provider.shutdown()

    def request(self, scope: Scope, method: str) -> AbstractContextManager[Any]:
        """Trace a request, as a part of the trace that its `traceparent` names."""
        # traceparent alone: other headers of the kind may contain anything.
        stated = Headers(scope=scope).get("traceparent")
        traced: AbstractContextManager[Any] = self._tracer.start_as_current_span(
            method,
            self._propagator.extract({} if stated is None else {"traceparent": stated}),
            kind=self._trace.SpanKind.SERVER,
            attributes={"http.request.method": method},
            record_exception=False,
            set_status_on_exception=False,
        )
        return traced

    def answered(
        self, span: Any, method: str, route: str | None, status: int, stages: Mapping[str, float]
    ) -> None:
        """Note the route and the status of an answer, and milliseconds by stage."""
        if route is not None:
            span.update_name(f"{method} {route}")
            span.set_attribute("http.route", route)
        for name, spent in stages.items():
            span.set_attribute(f"modalmotion.stage.{name}.milliseconds", round(spent, 1))
        span.set_attribute("http.response.status_code", status)
        if status >= 500:
            span.set_status(self._trace.StatusCode.ERROR)

    def task(self, kind: str, future: Future[Any]) -> None:
        """Trace a task, from handing it to the workers until its result.

        Parameters
        ----------
        kind : str
            Its name.
        future : Future
        """
        span = self._tracer.start_span(f"task {kind}", attributes={"modalmotion.task": kind})

        def end(done: Future[Any]) -> None:
            if done.cancelled() or done.exception() is not None:
                span.set_status(self._trace.StatusCode.ERROR)
            span.end()

        future.add_done_callback(end)


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
                status = status or gate.CLIENT_GONE
            except Exception:
                logger.exception("request failed", extra={"request_id": request_id})
                if not status:
                    await problems.internal_answer()(scope, receive, guarded(scope, observed))
            finally:
                seconds, route = time.perf_counter() - start, gate.route_of(scope)
                self.metrics.count(method, route or "other", status, seconds, n_received, n_sent)
                if self.telemetry:
                    self.telemetry.answered(span, method, route, status, stages)
                values = {"request_id": request_id, "method": method, "route": route}
                values |= {"status": status, "milliseconds": round(1e3 * seconds, 1)}
                logger.info("request", extra=values)
