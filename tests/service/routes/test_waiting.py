"""Every request that needs work waits so long and no longer, and ends when its client leaves."""

from __future__ import annotations

import asyncio
import io
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from job_requests import finished
from signing import signed

from modalmotion.client import Client
from modalmotion.formats import read_npz, write_npz
from modalmotion.simulate import simulate_ventricle
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

NOW = {"Prefer": "wait=0"}


@pytest.fixture(scope="module")
def beat() -> bytes:
    """A small one, for what is encoded takes its time."""
    return write_npz(simulate_ventricle(grid=(8, 16), rng=np.random.default_rng(7)))


@pytest.fixture(scope="module")
def known(shared_client: TestClient, beat: bytes) -> str:
    """A stored sequence with its signature, and its twin."""
    sequence = read_npz(beat).sequence
    for shift in (1, 0):
        buffer = io.BytesIO()
        np.savez(buffer, vertices=sequence.vertices[shift:], grid=(8, 16), topology="cup")
        answer = shared_client.post("/v1/sequences", content=buffer.getvalue())
    here: str = answer.headers["location"]
    signed(shared_client, here)
    return here


@pytest.fixture(scope="module")
def template(shared_client: TestClient, beat: bytes) -> str:
    location: str = shared_client.post("/v1/templates", content=beat).headers["location"]
    return location


@pytest.mark.parametrize("path", ["signature", "classify", "encode?rms=0.5"])
def test_an_upload_whose_answer_nobody_keeps_becomes_a_job(
    shared_client: TestClient, shared_data_dir: Path, beat: bytes, path: str
) -> None:
    at_once = shared_client.post(f"/v1/{path}", content=beat)
    assert at_once.status_code == 200
    answer = shared_client.post(f"/v1/{path}", content=beat, headers=NOW)
    assert answer.status_code == 202
    job = finished(shared_client, answer.json())
    assert job["state"] == "succeeded"
    result = shared_client.get(job["result"])
    assert result.headers["content-type"] == at_once.headers["content-type"]
    if path == "signature":
        assert result.json()["amplitudes"] == at_once.json()["amplitudes"]
    if path.startswith("encode"):
        assert result.content == at_once.content
        assert result.headers["encoded-rms"] == at_once.headers["encoded-rms"]
    # Of the upload nothing stays; of the result its file.
    left = {file.name for file in (shared_data_dir / "spool").iterdir()}
    assert len(left) == len([one for one in jobs_of(shared_client) if has_file(one)])


def jobs_of(client: TestClient) -> list[dict[str, Any]]:
    jobs: list[dict[str, Any]] = client.get("/v1/jobs").json()["jobs"]
    return jobs


def has_file(job: dict[str, Any]) -> bool:
    return (job["result"] or "").endswith("/result")


def test_the_query_says_how_long_to_wait_too(shared_client: TestClient, beat: bytes) -> None:
    answer = shared_client.post("/v1/signature?wait=0", content=beat)
    assert answer.status_code == 202
    assert finished(shared_client, answer.json())["state"] == "succeeded"
    assert shared_client.post("/v1/signature?wait=60", content=beat).status_code == 200
    for wrong in ("-1", "soon", "nan"):
        assert shared_client.post(f"/v1/signature?wait={wrong}", content=beat).status_code == 422


def test_what_respond_async_asks_for_is_a_job_at_once(
    shared_client: TestClient, beat: bytes
) -> None:
    stream = shared_client.post("/v1/encode?rms=0.5", content=beat).content
    answer = shared_client.post("/v1/decode", content=stream, headers={"Prefer": "respond-async"})
    assert answer.status_code == 202
    job = finished(shared_client, answer.json())
    decoded = read_npz(shared_client.get(job["result"]).content).sequence
    assert decoded.n_frames == read_npz(beat).sequence.n_frames
    bad = shared_client.post("/v1/signature", content=b"nonsense", headers=NOW)
    job = finished(shared_client, bad.json())
    assert (job["state"], job["error"]["code"]) == ("failed", "malformed_file")


def test_answers_about_what_is_stored_become_jobs_too(
    shared_client: TestClient, known: str, template: str
) -> None:
    other = shared_client.get("/v1/sequences").json()["sequences"][1]["id"]
    signature = signed(shared_client, known)
    for path in (
        f"{signature}/readouts",
        f"{signature}/distance?to={other}",
        f"{signature}/reconstruction?times=0,1",
        f"{known}/signature",
        signature,
        f"{known}/encoded?rms=0.5",
        f"{template}/modes",
        template,
    ):
        at_once = shared_client.get(path)
        assert at_once.status_code == 200, path
        answer = shared_client.get(path, headers=NOW)
        # What was there already may be there in no time.
        if answer.status_code == 202:
            job = finished(shared_client, answer.json())
            answer = shared_client.get(job["result"])
        assert answer.status_code == 200
        assert answer.content == at_once.content, path
        in_query = shared_client.get(f"{path}{'&' if '?' in path else '?'}wait=9")
        assert in_query.status_code == 200, path


def test_a_template_becomes_a_job_with_a_link(
    shared_client: TestClient, template: str, beat: bytes
) -> None:
    answer = shared_client.post("/v1/templates", content=beat, headers=NOW)
    assert answer.status_code == 202
    assert finished(shared_client, answer.json())["result"] == template


class Leaver:
    """One request to an app whose client leaves in the middle of it."""

    def __init__(self, app: Any, method: str, path: str, body: bytes = b"") -> None:
        route, _, query = path.partition("?")
        self.scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": method,
            "scheme": "http",
            "path": route,
            "raw_path": route.encode(),
            "query_string": query.encode(),
            "headers": [(b"host", b"localhost"), (b"content-length", str(len(body)).encode())],
            "client": ("127.0.0.1", 1),
            "server": ("127.0.0.1", 80),
            "app": app,
        }
        self.app = app
        self.messages: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.messages.put_nowait({"type": "http.request", "body": body, "more_body": False})
        self.sent: list[Any] = []

    async def run(self) -> None:
        async def send(message: Any) -> None:
            self.sent.append(message)

        await self.app(self.scope, self.messages.get, send)

    def leave(self) -> None:
        self.messages.put_nowait({"type": "http.disconnect"})


@contextmanager
def stopped_workers(app: Any) -> Iterator[Callable[[], list[bool]]]:
    """Have all work take for ever: nothing that is sent to a worker begins."""
    lanes = app.state.owners.local.analysis.engine.lanes
    submitted: list[Any] = []

    def put(task: Any) -> bool:
        submitted.append(task)
        return True

    lanes.put = put
    try:
        yield lambda: [task.future.cancelled() for task in submitted]
    finally:
        del lanes.put


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", "/v1/signature"),
        ("POST", "/v1/classify"),
        ("POST", "/v1/encode?rms=1"),
        ("POST", "/v1/decode"),
        ("POST", "/v1/templates"),
        ("POST", "/v1/sequences"),
        ("POST", "/tradeoff"),
        ("POST", "/signatures"),
        ("GET", "/readouts"),
        ("GET", "/reconstruction"),
        ("GET", "/encoded?rms=1"),
    ],
)
def test_work_ends_when_its_client_leaves(
    shared_client: TestClient,
    shared_data_dir: Path,
    known: str,
    beat: bytes,
    method: str,
    path: str,
) -> None:
    app: Any = shared_client.app
    signature = signed(shared_client, known)
    whole = f"{signature if path in ('/readouts', '/reconstruction') else known}{path}"
    if path.startswith("/v1"):
        whole = path
    elif method == "POST":
        beat = b'{"modes": 19}'
    files = set((shared_data_dir / "spool").iterdir())

    async def run() -> list[bool]:
        leaver = Leaver(app, method, whole, beat if method == "POST" else b"")
        request = asyncio.ensure_future(leaver.run())
        while not asked():
            assert not request.done(), leaver.sent
            await asyncio.sleep(0.01)
        assert asked() == [False]
        leaver.leave()
        await asyncio.wait_for(request, 20)
        assert not leaver.sent
        return asked()

    with stopped_workers(app) as asked:
        assert shared_client.portal is not None
        assert shared_client.portal.call(run) == [True]
    assert set((shared_data_dir / "spool").iterdir()) == files


def test_who_leaves_ends_nobody_elses_work(shared_client: TestClient, known: str) -> None:
    app: Any = shared_client.app

    async def run() -> list[bool]:
        first, second = (
            Leaver(app, "POST", f"{known}/signatures", b'{"modes": 23}') for _ in range(2)
        )
        requests = [asyncio.ensure_future(one.run()) for one in (first, second)]
        while len(asked()) < 2:
            await asyncio.sleep(0.01)
        first.leave()
        await asyncio.wait_for(requests[0], 20)
        still = asked()
        second.leave()
        await asyncio.wait_for(requests[1], 20)
        return [*sorted(still), *asked()]

    with stopped_workers(app) as asked:
        assert shared_client.portal is not None
        assert shared_client.portal.call(run) == [False, True, True, True]


def test_requests_without_a_worker_end_with_a_job_or_by_name(tmp_path: Path, beat: bytes) -> None:
    settings = Settings(data_dir=tmp_path / "results", workers=1, wait_seconds=0.3)
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        app: Any = client.app
        engine = app.state.owners.local.analysis.engine
        with stopped_workers(app):
            start = time.monotonic()
            for path in (
                "signature",
                "classify",
                "encode?rms=1",
                "decode",
                "sequences",
                "templates",
            ):
                answer = client.post(f"/v1/{path}", content=beat)
                assert answer.status_code == 202, path
                client.delete(answer.json()["links"]["self"])
            assert time.monotonic() - start < 60
        assert engine.n_waiting == {"short": 0, "long": 0}
        assert not list((tmp_path / "results" / "spool").iterdir())


def test_the_client_waits_for_jobs(tmp_path: Path, beat: bytes) -> None:
    settings = Settings(data_dir=tmp_path / "results", workers=1, wait_seconds=0.0)
    with TestClient(create_app(settings), raise_server_exceptions=False) as app:
        client = Client("http://testserver", transport=app._transport)
        signature = client.signature_of(beat)
        assert signature.rms_error > 0
        stream = client.encode(beat, rms=0.5)
        assert client.decode(stream.data).n_frames == signature.n_frames
        info = client.make_template(beat)
        assert client.template(info.id) == info
