"""Bad input is answered as application/problem+json, and leaves the store as it was."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from modalmotion.errors import ModalMotionError
from modalmotion_service.errors import ServiceError
from modalmotion_service.http.problems import problem_of

LIMIT_BYTES = 2_000_000
VERTICES = np.random.default_rng(5).normal(size=(3, 16, 3))


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def data_dir(shared_data_dir: Path) -> Path:
    return shared_data_dir


def saved(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def holed(value: float) -> bytes:
    vertices = VERTICES.copy()
    vertices[1, 2, 0] = value
    return saved(vertices=vertices)


BAD: dict[str, tuple[bytes, int, str, dict[str, object]]] = {
    "empty": (b"", 400, "malformed_file", {}),
    "half a file": (saved(vertices=VERTICES)[:700], 400, "malformed_file", {}),
    "text": (b"x,y,z\n1,2,3\n", 400, "malformed_file", {}),
    "JSON": (b'{"vertices": [[[0, 0, 0]]]}', 400, "malformed_file", {}),
    "object arrays": (
        saved(vertices=np.array([None], dtype=object)),
        400,
        "malformed_file",
        {},
    ),
    "no vertices": (saved(points=VERTICES), 400, "malformed_file", {}),
    "NaN": (holed(np.nan), 422, "non_finite", {"frame": 1, "vertex": 2}),
    "infinity": (holed(-np.inf), 422, "non_finite", {"frame": 1, "vertex": 2}),
    "flat": (saved(vertices=VERTICES[0]), 422, "wrong_shape", {}),
    "two coordinates": (saved(vertices=VERTICES[:, :, :2]), 422, "wrong_shape", {}),
    "no frame": (saved(vertices=VERTICES[:0]), 422, "wrong_shape", {}),
    "face out of range": (
        saved(vertices=VERTICES, faces=[[0, 1, 16]]),
        422,
        "bad_connectivity",
        {"vertex": 16, "face": 0},
    ),
    "negative face": (saved(vertices=VERTICES, faces=[[0, 1, -1]]), 422, "bad_connectivity", {}),
    "grid that does not fit": (saved(vertices=VERTICES, grid=[3, 4]), 422, "wrong_shape", {}),
    "unknown topology": (
        saved(vertices=VERTICES, topology="knot"),
        422,
        "unsupported_topology",
        {},
    ),
    "two frames at one time": (
        saved(vertices=VERTICES, times=[0, 1, 1]),
        422,
        "wrong_shape",
        {"frame": 2},
    ),
    "too few times": (saved(vertices=VERTICES, times=[0, 1]), 422, "wrong_shape", {}),
    "too many frames": (
        saved(vertices=np.zeros((101, 1, 3))),
        413,
        "limit_exceeded",
        {"limit": "frames", "most": 100},
    ),
    "too large": (bytes(LIMIT_BYTES + 1), 413, "limit_exceeded", {"limit": "body_bytes"}),
}


@pytest.mark.parametrize("form", [False, True], ids=["raw", "form"])
@pytest.mark.parametrize("kind", BAD)
def test_bad_uploads_say_what_and_where_and_change_nothing(
    client: TestClient, data_dir: Path, kind: str, form: bool
) -> None:
    body, status, code, members = BAD[kind]
    before = sorted(data_dir.rglob("*.h5"))
    if form:
        answer = client.post("/v1/sequences", files={"file": ("x.npz", body)})
    else:
        answer = client.post("/v1/sequences", content=body)
    problem = answer.json()
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, problem["status"], problem["code"]) == (status, status, code)
    assert problem["detail"]
    assert problem["remedy"]
    assert members.items() <= problem.items()
    assert sorted(data_dir.rglob("*.h5")) == before
    assert client.get("/health/ready").status_code == 200


def test_a_body_without_a_declared_length_is_limited_too(client: TestClient) -> None:
    answer = client.post("/v1/sequences", content=(bytes(100_000) for _ in range(30)))
    assert (answer.status_code, answer.json()["limit"]) == (413, "body_bytes")


def test_a_form_without_the_file_says_so(client: TestClient) -> None:
    answer = client.post("/v1/sequences", files={"upload": ("x.npz", b"abc")})
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_request")
    answer = client.post("/v1/sequences", data={"unit": "mm"}, files={"manifest": (None, "x")})
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_request")
    answer = client.post("/v1/sequences", files={"unit": (None, "mm")})
    assert (answer.status_code, answer.json()["code"]) == (400, "malformed_file")
    assert "'file'" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/v1/sequences/" + "0" * 64, 404, "not_found"),
        ("GET", "/v1/sequences/" + "0" * 64 + "/signature", 404, "not_found"),
        ("POST", "/v1/signatures/" + "0" * 64 + "/classifications", 404, "not_found"),
        ("GET", "/v1/sequences/..%2f..%2fetc", 404, "not_found"),
        ("GET", "/v1/sequences/ABC", 422, "invalid_request"),
        ("GET", "/nowhere", 404, "not_found"),
        ("PUT", "/v1/sequences", 405, "method_not_allowed"),
        ("POST", "/v1/sequences?grid=0,4", 422, "invalid_request"),
        ("POST", "/v1/sequences?colour=red", 422, "invalid_request"),
    ],
)
def test_every_error_is_a_problem(
    client: TestClient, method: str, path: str, status: int, code: str
) -> None:
    answer = client.request(method, path, content=b"abc" if "?" in path else None)
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, answer.json()["code"]) == (status, code)


@pytest.mark.parametrize(
    ("query", "status", "code"),
    [
        ({"modes": "0"}, 422, "invalid_request"),
        ({"modes": "seven"}, 422, "invalid_request"),
        ({"modes": "999999999999999999999"}, 422, "invalid_request"),
        ({"modes": "900"}, 422, "bad_mode_count"),
        ({"reference": "1000"}, 422, "bad_parameter"),
        ({"reference": "99999999999999999999999"}, 422, "bad_parameter"),
        ({"topology": "knot"}, 422, "unsupported_topology"),
        ({"grid": [3, 7]}, 422, "invalid_request"),
        ({"tolerance": "nan"}, 422, "invalid_request"),
        ({"components": "heavy"}, 422, "invalid_request"),
        ({"surprise": "1"}, 422, "invalid_request"),
    ],
)
def test_bad_parameters_are_refused(
    client: TestClient,
    npz: Callable[..., bytes],
    query: dict[str, Any],
    status: int,
    code: str,
) -> None:
    body = npz(vertices=VERTICES, grid=[4, 4], topology="cup")
    here = client.post("/v1/sequences", content=body).headers["location"]
    answer = client.post(f"{here}/signatures", json=query)
    assert (answer.status_code, answer.json()["code"]) == (status, code)


def test_points_without_faces_are_kept_but_have_no_signature(
    client: TestClient, npz: Callable[..., bytes]
) -> None:
    here = client.post("/v1/sequences", content=npz(vertices=VERTICES)).headers["location"]
    answer = client.get(f"{here}/signature")
    assert (answer.status_code, answer.json()["code"]) == (422, "unsupported_topology")
    assert answer.json()["remedy"]


def test_an_unknown_model_is_not_found(client: TestClient, beat: bytes) -> None:
    named = f"/v1/signatures/{client.post('/v1/sequences', content=beat).json()['id']}"
    for body in ({"model": "../../etc/passwd"}, {"model": "nobody"}):
        answer = client.post(f"{named}/classifications", json=body)
        assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
    assert client.post(f"{named}/classifications", content=b"{").status_code == 422


@pytest.mark.parametrize(
    ("accept", "status"),
    [
        ("*/*", 200),
        ("application/*", 200),
        ("application/json;q=0.5, application/x-hdf5", 200),
        ("text/html", 406),
        ("application/json;q=0", 406),
        (";;;,,q=", 406),
    ],
)
def test_the_type_of_an_answer_is_negotiated(
    client: TestClient, beat: bytes, accept: str, status: int
) -> None:
    here = client.post("/v1/sequences", content=beat).headers["location"]
    answer = client.get(f"{here}/signature", headers={"Accept": accept})
    assert answer.status_code == status
    if "hdf5" in accept:
        assert answer.headers["content-type"] == "application/x-hdf5"


def test_what_has_one_type_alone_is_not_given_to_who_accepts_another(
    client: TestClient, beat: bytes
) -> None:
    here = client.post("/v1/sequences", content=beat).headers["location"]
    calls: tuple[tuple[str, str, bytes, str], ...] = (
        ("POST", "/v1/classify", beat, "text/csv"),
        ("POST", "/v1/encode?rms=1", beat, "application/json"),
        ("GET", f"/v1/signatures/{here.rpartition('/')[2]}/strain", b"", "text/csv"),
    )
    for method, path, body, accept in calls:
        answer = client.request(method, path, content=body, headers={"Accept": accept})
        assert (path, answer.status_code) == (path, 406)


def test_an_unexpected_failure_tells_nothing_of_the_inside(
    client: TestClient, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def broken(*_: object) -> None:
        raise RuntimeError("secret path")

    here = client.post("/v1/sequences", content=beat).headers["location"]
    monkeypatch.setattr("modalmotion_service.workspace.analysis.Analysis.signature", broken)
    answer = client.post(f"{here}/signatures", json={"modes": 9})
    assert (answer.status_code, answer.json()["code"]) == (500, "internal_error")
    assert "secret" not in answer.text
    # The headers of every other answer, too.
    own = {"location", "etag", "ratelimit"}
    assert {*client.get("/v1/limits").headers} - own <= {*answer.headers}
    assert answer.headers["cache-control"] == "no-store"


def test_every_kind_of_our_errors_has_a_status() -> None:
    kinds: list[type[ModalMotionError]] = [ModalMotionError]
    for kind in kinds:
        kinds.extend(kind.__subclasses__())
    assert len(kinds) > 10
    for kind in kinds:
        status = problem_of(kind("text")).status_code
        assert 400 <= status < 600
        # None of the service's own is a fault of it.
        assert not (issubclass(kind, ServiceError) and kind is not ServiceError and status == 500)


def test_a_fault_of_the_disk_that_nobody_has_explained_is_no_fault_of_the_service(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/secret/folder/file")

    monkeypatch.setattr("modalmotion.store.ResultStore.list_sequences", full)
    answer = client.get("/v1/sequences")
    assert (answer.status_code, answer.json()["code"]) == (507, "store_error")
    assert "secret" not in answer.text
