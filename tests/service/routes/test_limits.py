"""Limits are stated, and each is named by the error that it causes."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from modalmotion.errors import StoreError
from modalmotion.store import ResultStore
from modalmotion_service.app import create_app
from modalmotion_service.http.middleware import Concurrency
from modalmotion_service.log_lines import JsonFormatter
from modalmotion_service.settings import Settings


def test_every_limit_is_published(client: TestClient) -> None:
    limits = client.get("/v1/limits").json()
    assert limits["body_bytes"] == 2_000_000
    assert limits["frames"] == 100
    assert all(value > 0 for value in limits.values())


def test_settings_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MODALMOTION_MAX_FRAMES", "12")
    assert Settings().read_limits.frames == 12
    monkeypatch.setenv("MODALMOTION_MAX_FRAMES", "none")
    with pytest.raises(ValueError, match="max_frames"):
        Settings()


@pytest.mark.parametrize(
    ("settings", "path", "limit"),
    [
        ({"max_query_ids": 1}, "/v1/signatures/query", "query_ids"),
        ({"max_body_bytes": 10}, "/v1/signatures/query", "body_bytes"),
    ],
)
def test_limits_on_json_requests(
    tmp_path: Path, settings: dict[str, int], path: str, limit: str
) -> None:
    app = create_app(Settings(data_dir=tmp_path / "r", **settings))  # type: ignore[arg-type]
    with TestClient(app, raise_server_exceptions=False) as client:
        body = json.dumps({"ids": ["0" * 64] * 2}).encode()
        kind = {"Content-Type": "application/json"}
        whole = client.post(path, content=body, headers=kind)
        pieces = client.post(path, content=iter([body[:5], body[5:]]), headers=kind)
        for answer in (whole, pieces):
            assert (answer.status_code, answer.json()["limit"]) == (413, limit)
            assert limit in client.get("/v1/limits").json()


def test_more_at_once_than_are_served_are_told_to_wait(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "r", max_concurrent_requests=1)
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        # The test client sends one request after another; the crash tests send many at once.
        middleware = client.app.middleware_stack  # type: ignore[attr-defined]
        while not isinstance(middleware, Concurrency):
            middleware = middleware.app
        middleware.under_way[None] = 1
        answer = client.get("/v1/limits")
        assert (answer.status_code, answer.json()["limit"]) == (429, "concurrent_requests")
        assert answer.headers["retry-after"] == "1"
        assert client.get("/health/live").status_code == 200
        middleware.under_way[None] = 0
        assert client.get("/v1/limits").status_code == 200


def test_two_services_on_one_folder_are_refused(client: TestClient, data_dir: Path) -> None:
    with pytest.raises(StoreError, match="process"), ResultStore(data_dir):
        pass
    assert client.get("/health/ready").status_code == 200


def test_log_lines_are_json_without_patient_data(
    client: TestClient, beat: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, logger="modalmotion_service.requests"):
        client.post("/v1/sequences?subject=Jane%20Doe&label=infarct", content=beat)
        client.get("/v1/sequences/Jane-Doe")
    lines = [JsonFormatter().format(record) for record in caplog.records]
    requests = [json.loads(line) for line in lines if json.loads(line)["message"] == "request"]
    assert [line["status"] for line in requests] == [201, 422]
    assert requests[0]["route"] == "/v1/sequences"
    assert requests[1]["route"] == "/v1/sequences/{sequence_id}"
    assert all(line["request_id"] and line["milliseconds"] >= 0 for line in requests)
    assert not [line for line in lines if "Jane" in line or "infarct" in line]


def test_a_disk_that_fails_is_a_problem_and_loses_nothing(
    client: TestClient, beat: bytes, data_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import errno
    import os

    real = os.fsync

    def failing(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", failing)
    answer = client.post("/v1/sequences", content=beat)
    monkeypatch.setattr(os, "fsync", real)
    assert (answer.status_code, answer.json()["code"]) == (507, "store_error")
    assert answer.json()["remedy"]
    assert not list(data_dir.rglob("*.h5"))
    assert client.post("/v1/sequences", content=beat).status_code == 201
