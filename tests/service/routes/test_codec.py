"""Encoding and decoding over HTTP."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from fastapi.testclient import TestClient

from modalmotion.formats import read_npz, write_npz
from modalmotion.simulate import Acquisition, simulate_ventricle

STREAM = "application/vnd.modalmotion.stream"


@pytest.fixture(scope="module")
def client(engine_client: TestClient) -> TestClient:
    return engine_client


@pytest.fixture(scope="module")
def mesh() -> bytes:
    return write_npz(
        simulate_ventricle(
            n_vertices=100, acquisition=Acquisition(n_frames=8), rng=np.random.default_rng(3)
        )
    )


@pytest.mark.parametrize("target", ["max_error", "rms"])
def test_a_sequence_comes_back_within_the_error_that_was_asked_for(
    client: TestClient, mesh: bytes, target: str
) -> None:
    answer = client.post("/v1/encode", params={target: 0.3}, content=mesh)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == STREAM
    assert int(answer.headers["encoded-n-bytes"]) == len(answer.content) < len(mesh) / 3
    decoded = read_npz(client.post("/v1/decode", content=answer.content).content).sequence
    original = read_npz(mesh).sequence
    difference = decoded.vertices.astype(float) - original.vertices
    if target == "max_error":
        assert np.abs(difference).max() <= 0.3
    rms = float(np.sqrt((difference**2).sum(axis=2).mean()))
    assert rms <= 0.3
    assert rms == pytest.approx(float(answer.headers["encoded-rms"]), rel=1e-6)


def test_the_effort_is_chosen(client: TestClient, mesh: bytes) -> None:
    streams = {
        effort: client.post(f"/v1/encode?rms=0.3&effort={effort}", content=mesh)
        for effort in ("fast", "balanced")
    }
    assert len(streams["balanced"].content) <= len(streams["fast"].content)
    answer = client.post("/v1/decode", content=streams["fast"].content)
    assert answer.status_code == 200


def test_some_frames_and_other_formats(client: TestClient, mesh: bytes) -> None:
    stream = client.post("/v1/encode?rms=0.5", content=mesh).content
    whole = read_npz(client.post("/v1/decode", content=stream).content).sequence
    some = client.post("/v1/decode?first=2&stop=5", content=stream)
    assert np.array_equal(read_npz(some.content).sequence.vertices, whole.vertices[2:5])
    for odd in ("first=3", "first=3&stop=3", f"first=0&stop={10**30}"):
        refused = client.post(f"/v1/decode?{odd}", content=stream)
        assert refused.status_code == 422
        assert refused.json()["remedy"]
    raw = client.post("/v1/decode", content=stream, headers={"Accept": "application/octet-stream"})
    assert raw.content == whole.vertices.astype("<f4").tobytes()
    vtkhdf = client.post(
        "/v1/decode", content=stream, headers={"Accept": "application/vnd.vtk.vtkhdf"}
    )
    assert vtkhdf.content.startswith(b"\x89HDF")


def test_a_kept_sequence_is_encoded_now_or_by_a_job(client: TestClient, mesh: bytes) -> None:
    here = client.post("/v1/sequences", content=mesh).headers["location"]
    now = client.get(f"{here}/encoded?rms=0.5")
    assert now.status_code == 200
    job = client.get(f"{here}/encoded?rms=0.5", headers={"Prefer": "respond-async"}).json()
    for _ in range(400):
        job = client.get(job["links"]["self"]).json()
        if job["state"] not in ("queued", "running"):
            break
        time.sleep(0.05)
    later = client.get(job["result"])
    assert later.content == now.content
    assert later.headers["content-type"] == STREAM
    assert later.headers["encoded-rms"] == now.headers["encoded-rms"]


@pytest.mark.parametrize(
    ("path", "change", "status"),
    [
        ("/v1/encode?rms=1&max_error=3", lambda data: data, 422),
        ("/v1/encode?rms=-1", lambda data: data, 422),
        ("/v1/encode?rms=1", lambda data: data[:99], 400),
        ("/v1/decode", lambda data: data, 400),
        ("/v1/decode", lambda _: b"", 400),
    ],
)
def test_what_cannot_be_coded_is_a_problem(
    client: TestClient, mesh: bytes, path: str, change: Callable[[bytes], bytes], status: int
) -> None:
    answer = client.post(path, content=change(mesh))
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["detail"]


def test_a_damaged_stream_is_refused(client: TestClient, mesh: bytes) -> None:
    stream = bytearray(client.post("/v1/encode?rms=0.5", content=mesh).content)
    for at in range(0, len(stream), max(1, len(stream) // 12)):
        damaged = stream.copy()
        damaged[at] ^= 0x10
        answer = client.post("/v1/decode", content=bytes(damaged))
        assert answer.status_code in (400, 413, 422), at
    cut = client.post("/v1/decode", content=bytes(stream[: len(stream) // 2]))
    assert (cut.status_code, cut.json()["code"]) == (400, "malformed_file")
