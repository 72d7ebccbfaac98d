"""Figures for Prometheus: names, values, and a number of series that clients cannot raise."""

from __future__ import annotations

from pathlib import Path

import pytest
from access_parts import guarded
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families

from modalmotion_service.access.scopes import Scope
from modalmotion_service.monitoring.metrics import Metrics
from modalmotion_service.work.pool import WorkerPool

Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def samples(text: str) -> Samples:
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def value(found: Samples, name: str, **labels: str) -> float:
    return found[f"modalmotion_{name}", frozenset(labels.items())]


def test_figures_count_what_happened(client: TestClient, beat: bytes) -> None:
    known = client.post("/v1/sequences", content=beat).json()["id"]
    client.post(f"/v1/sequences/{known}/signatures")
    client.post("/v1/sequences", content=b"nonsense")
    job = client.post(
        f"/v1/sequences/{known}/signatures", json={"modes": 11}, headers={"Prefer": "respond-async"}
    ).json()["id"]
    while client.get(f"/v1/jobs/{job}").json()["state"] != "succeeded":
        pass
    answer = client.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=")
    found = samples(answer.text)
    upload = {"method": "POST", "route": "/v1/sequences"}
    assert value(found, "requests_total", **upload, status="201") == 1
    assert value(found, "requests_total", **upload, status="400") == 1
    assert value(found, "request_seconds_count", **upload) == 2
    assert value(found, "received_bytes_total", route="/v1/sequences") == len(beat) + 8
    assert value(found, "sent_bytes_total", route="/v1/sequences") > 100
    assert value(found, "task_seconds_count", kind="ingest") == 2
    assert value(found, "tasks_failed_total", kind="ingest") == 1
    assert value(found, "task_seconds_count", kind="sign") == 2
    assert value(found, "jobs", kind="signature", state="succeeded") == 1
    assert value(found, "stored", kind="sequence") == 1
    assert value(found, "stored", kind="signature") == 2
    waiting = [value(found, "tasks_waiting", lane=lane) for lane in ("short", "long")]
    assert [value(found, "workers_busy"), *waiting] == [0, 0, 0]
    assert value(found, "workers") >= 1
    assert value(found, "disk_free_bytes") > 0


def test_tasks_of_an_engine_without_lanes_wait_beyond_its_workers(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(WorkerPool, "n_waiting", {})
    monkeypatch.setattr(Metrics, "tasks_under_way", 700)
    found = samples(client.get("/metrics").text)
    n_workers = value(found, "workers")
    waiting = [value(found, "tasks_waiting", lane=lane) for lane in ("short", "long")]
    assert [value(found, "workers_busy"), *waiting] == [n_workers, 0, 700 - n_workers]


def test_refusals_are_counted_and_stores_added_up(tmp_path: Path, beat: bytes) -> None:
    with guarded(tmp_path, max_failures_per_minute=2) as service:
        for owner in ("a", "b"):
            assert service.ask(owner, "POST", "/v1/sequences", content=beat).status_code == 201
        for _ in range(3):
            service.client.get("/v1/sequences")
        found = samples(service.ask("watch", "GET", "/metrics", Scope.METRICS).text)
    listing = {"method": "GET", "route": "/v1/sequences"}
    assert value(found, "requests_total", **listing, status="401") == 2
    assert value(found, "requests_total", **listing, status="429") == 1
    assert value(found, "stored", kind="sequence") == 2
    assert value(found, "owners") == 3  # the folder's own, a, b; a scrape opens none


def test_nothing_a_client_makes_up_becomes_a_label(client: TestClient) -> None:
    before = len(samples(client.get("/metrics").text))
    for number in range(30):
        client.get(f"/made/up/{number}")
        client.request(f"MADEUP{number}", "/v1/sequences")
        client.get(f"/v1/sequences/{number:064x}")
    text = client.get("/metrics").text
    # A few series for three routes and two statuses, each with its histogram.
    assert len(samples(text)) < before + 120
    assert "MADEUP" not in text
    assert "made/up" not in text
    assert 'route="other"' in text


@pytest.mark.parametrize("name", ["owner", "key", "client", "id"])
def test_no_figure_names_anybody(client: TestClient, name: str) -> None:
    client.get("/v1/sequences")
    assert not [
        labels
        for _, labels in samples(client.get("/metrics").text)
        if name in {label for label, _ in labels}
    ]


def test_two_apps_count_apart(tmp_path: Path) -> None:
    with (
        guarded(tmp_path / "1", require_keys=False) as one,
        guarded(tmp_path / "2", require_keys=False) as two,
    ):
        one.client.get("/v1/limits")
        assert 'route="/v1/limits"' in one.client.get("/metrics").text
        assert 'route="/v1/limits"' not in two.client.get("/metrics").text
