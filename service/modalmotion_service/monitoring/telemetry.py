"""Traces by OpenTelemetry, where an operator wants them: requests and tasks, and never an id.

A span has the route's template, the method, the status and milliseconds by stage: neither path nor
query nor anything of a body, no owner, key, sequence or job, and no text of an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager
from importlib.metadata import version
from typing import Any

from starlette.datastructures import Headers
from starlette.types import Scope

from modalmotion.errors import needs_extra


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
