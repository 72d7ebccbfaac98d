"""Hostile requests over a real connection: no 5xx, no hang, and the service goes on."""

from __future__ import annotations

import contextlib
import io
import json
import random
import socket
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hostile_requests import hostile_request
from running import RunningService

from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope

# Longer than any limit on time below: an answer that comes later is a hang.
PATIENCE = 30.0


def npz(n_frames: int = 4) -> bytes:
    vertices = np.random.default_rng(3).normal(size=(n_frames, 64, 3))
    buffer = io.BytesIO()
    np.savez(buffer, vertices=vertices, grid=(8, 8), topology="cup", unit="mm")
    return buffer.getvalue()


@pytest.fixture
def service(tmp_path: Path) -> Iterator[RunningService]:
    settings = {
        "REQUIRE_KEYS": "true",
        "MAX_REQUESTS_PER_MINUTE": "10000000",
        "MAX_FAILURES_PER_MINUTE": "10000000",
        "MAX_ANONYMOUS_PER_MINUTE": "10000000",
        "MAX_DECOMPRESSED_BYTES": "20000000",
        "IDLE_SECONDS": "5",
        "TASK_SECONDS": "15",
        "WORKERS": "2",
    }
    running = RunningService(tmp_path / "results", settings)
    yield running.start()
    running.stop()


def answer_to(request: bytes, port: int) -> tuple[int, bytes]:
    """Status of the answer, 0 where the connection was closed without one; and its beginning."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as connection:
        answer, is_waiting = b"", True
        # Refused before all of it was sent: what was answered is still to be read.
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            connection.sendall(request)
        with contextlib.suppress(ConnectionResetError):
            connection.settimeout(1.0)
            while is_waiting:
                try:
                    piece = connection.recv(65536)
                    answer, is_waiting = (answer + piece)[:4096], bool(piece)
                except TimeoutError:
                    assert connection.gettimeout() == 1.0, request[:1000]
                    # The server may be waiting for the rest of a body: tell it that none comes.
                    with contextlib.suppress(OSError):
                        connection.shutdown(socket.SHUT_WR)
                    connection.settimeout(PATIENCE)
    if not answer:
        return 0, b""
    assert answer.startswith(b"HTTP/1.1 "), answer[:200]
    return int(answer[9:12]), answer


def attack(service: RunningService, n_requests: int, seed: int) -> Counter[int]:
    with KeyRing(service.data_dir) as ring:
        token = ring.create("lab", frozenset(Scope))[1]
    key = {"Authorization": f"Bearer {token}"}
    sequence = service.request("POST", "/v1/sequences", npz(), key).json["id"]
    # What is deleted on the way is made again by the bodies that are no damaged ones.
    ids = {
        "sequence_id": sequence,
        "template_id": service.request("POST", "/v1/templates", npz(), key).json["id"],
        "job_id": service.request(
            *("POST", f"/v1/sequences/{sequence}/signatures", b""),
            {**key, "Prefer": "respond-async"},
        ).json["id"],
        "name": "ventricle-simulated",
        "key": sequence,
    }

    def one(number: int) -> int:
        rng = random.Random(seed * 1_000_000 + number)  # noqa: S311 (no secret)
        request = hostile_request(rng, ids, token, npz())
        status, answer = answer_to(request, service.port)
        assert status < 500, (number, request[:1500], answer)
        if status >= 400 and not request.startswith(b"HEAD"):
            assert b"content-type: application/problem+json" in answer.lower(), (number, answer)
        return status

    with ThreadPoolExecutor(4) as clients:
        statuses = Counter(clients.map(one, range(n_requests)))
    assert service.request("GET", "/health/ready").status == 200
    assert service.request("POST", "/v1/sequences", npz(5), key).status in (200, 201)
    lines = service.log.read_text().splitlines()
    assert [line[-1500:] for line in lines if "Traceback" in line] == []
    logged = [json.loads(line) for line in lines if line.startswith("{")]
    # At its start it says itself that it is not ready yet.
    told = [one.get("status", 0) for one in logged if one.get("route") != "/health/ready"]
    assert max(told) < 500
    assert len(told) > n_requests / 2
    return statuses


def test_hostile_requests_are_answered_and_do_no_harm(service: RunningService) -> None:
    statuses = attack(service, 200, seed=1)
    assert sum(statuses.values()) == 200
    assert {200, 400, 401, 404, 405, 422} <= set(statuses)


def test_what_is_no_http_is_answered_as_a_problem_too(service: RunningService) -> None:
    long = b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n"
    head = b"HEAD / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n"
    assert answer_to(head, service.port)[0] in (400, 401)
    for request in (b"nonsense\r\n\r\n", b"GET / HTTP/1.1\r\nA B: c\r\n\r\n", long):
        status, answer = answer_to(request, service.port)
        assert status == 400
        assert b'"code": "malformed_file"' in answer
        assert b"application/problem+json" in answer
    assert "Traceback" not in service.log.read_text()


@pytest.mark.soak
def test_twenty_thousand_hostile_requests(service: RunningService) -> None:
    statuses = attack(service, 20_000, seed=2)
    print(f"{sum(statuses.values())} hostile requests, no 5xx: {dict(sorted(statuses.items()))}")  # noqa: T201
