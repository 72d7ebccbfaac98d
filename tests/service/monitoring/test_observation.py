"""Traces: of requests and tasks, within the caller's, and without any id."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from modalmotion.errors import MissingExtraError
from modalmotion_service.app import create_app
from modalmotion_service.monitoring.observation import Telemetry
from modalmotion_service.settings import Settings

pytest.importorskip("opentelemetry.sdk")

TRACE, PARENT = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"


@pytest.fixture
def spans() -> Any:
    from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter

    return InMemorySpanExporter()


@pytest.fixture
def client(spans: Any, tmp_path: Path) -> Iterator[TestClient]:
    from opentelemetry.sdk.trace.export import SimpleSpanProcessor

    settings = Settings(data_dir=tmp_path, workers=1, wait_seconds=120.0)
    app = create_app(settings, Telemetry(SimpleSpanProcessor(spans)))
    with TestClient(app, raise_server_exceptions=False) as client:
        yield client


# A service of its own: 2 s.
def test_requests_and_tasks_are_traced_and_nothing_says_whose(
    client: TestClient, spans: Any, beat: bytes
) -> None:
    headers = {
        "traceparent": f"00-{TRACE}-{PARENT}-01",
        "baggage": "user=jane",
        "tracestate": "user=jane",
        "X-Request-ID": "jane-17",
    }
    sent = client.post("/v1/sequences?subject=Jane", content=beat, headers=headers)
    sequence_id = sent.json()["id"]
    client.post(f"/v1/sequences/{sequence_id}/signatures", json={"modes": 5})
    client.get("/v1/models/janes-model")
    client.request("BREW", "/v1/jane")
    broken = client.post("/v1/sequences", content=b"jane's bytes")
    assert broken.status_code == 400
    done = spans.get_finished_spans()
    named = {span.name: span for span in done}
    upload = next(span for span in done if span.name == "POST /v1/sequences")
    assert f"{upload.context.trace_id:032x}" == TRACE
    assert f"{upload.parent.span_id:016x}" == PARENT
    assert upload.attributes["http.response.status_code"] == 201
    assert upload.attributes["modalmotion.stage.worker.milliseconds"] >= 0
    task = next(span for span in done if span.name == "task ingest")
    assert task.parent.span_id == upload.context.span_id
    assert "POST /v1/sequences/{sequence_id}/signatures" in named
    assert named["GET /v1/models/{name}"].attributes["http.response.status_code"] == 404
    assert "_OTHER" in named
    said = "".join(span.to_json() for span in done).lower()
    for secret in ("jane", sequence_id, sequence_id[:12], "testserver", "subject"):
        assert secret not in said, secret


def test_without_the_setting_nothing_of_it_is_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    create_app(Settings(data_dir=tmp_path))
    with pytest.raises(MissingExtraError):
        create_app(Settings(data_dir=tmp_path, telemetry=True))


def test_without_an_exporter_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "opentelemetry.exporter.otlp.proto.http.trace_exporter"
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError) as missing:
        create_app(Settings(data_dir=tmp_path, telemetry=True))
    assert "pip install opentelemetry-sdk" in missing.value.remedy


def test_the_framework_sends_nothing_to_a_collector_of_the_whole_process(
    spans: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from opentelemetry import trace
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import SimpleSpanProcessor

    provider = TracerProvider(shutdown_on_exit=False)
    provider.add_span_processor(SimpleSpanProcessor(spans))
    monkeypatch.setattr(trace, "get_tracer_provider", lambda: provider)
    client = TestClient(create_app(Settings(data_dir=tmp_path)))
    assert client.get("/v1/nowhere?subject=Jane").status_code == 404
    assert spans.get_finished_spans() == ()
