"""A service that keeps nothing: the same answers, no store, any number of them side by side."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from running import RunningService

from modalmotion.classification import load_model
from modalmotion.errors import ParameterError
from modalmotion.store import ResultStore, signature_from_hdf5
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import SCOPE_OF, Scope
from modalmotion_service.app import SERVED, create_app
from modalmotion_service.commands.server import require_keys_to_serve, without_store
from modalmotion_service.settings import Settings

HERS = "owners/alice"


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a service with a store: a model of one owner, and nothing may be written to it."""
    folder = tmp_path_factory.mktemp("kept") / "results"
    with ResultStore(folder / HERS) as store:
        for _ in range(3):
            store.put_model(replace(load_model(), name="hers"))
        store.delete_model("hers", 3)
    return folder


@pytest.fixture(scope="module")
def token(data_dir: Path) -> str:
    with KeyRing(data_dir) as ring:
        token = ring.create("alice", [Scope.READ, Scope.ADMIN, Scope.WRITE])[1]
        ring.create("bob", [Scope.READ])
    return token


@pytest.fixture(scope="module")
def audit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("audit") / "lines"


@pytest.fixture(scope="module")
def client(
    data_dir: Path, token: str, audit: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[TestClient]:
    settings = Settings(
        data_dir=tmp_path_factory.mktemp("under way") / "results",
        workers=1,
        stateless=True,
        read_only_dir=data_dir,
        audit_stream=str(audit),
        max_requests_per_minute=200,
    )
    before = files_of(data_dir)
    headers = {"Authorization": f"Bearer {token}"}
    with TestClient(create_app(settings), headers=headers) as client:
        yield client
    assert files_of(data_dir) == before


def files_of(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob("*")}


def test_answers_are_those_of_a_service_with_a_store(
    client: TestClient, shared_client: TestClient, beat: bytes
) -> None:
    hdf5 = {"Accept": "application/x-hdf5"}
    own, other = (
        signature_from_hdf5(one.post("/v1/signature?modes=5", content=beat, headers=hdf5).content)
        for one in (client, shared_client)
    )
    assert np.array_equal(own.amplitudes, other.amplitudes)
    both = [one.post("/v1/classify", content=beat).json() for one in (client, shared_client)]
    assert both[0] == both[1]


def test_an_owners_models_are_served_in_their_versions(client: TestClient, beat: bytes) -> None:
    answer = client.get("/v1/models/hers").json()
    assert answer["versions"] == [1, 2]
    answer = client.post("/v1/classify?model=hers@1", content=beat).json()
    assert (answer["model"], answer["version"]) == ("hers", 1)
    assert client.get("/v1/models/hers@3").status_code == 404


def test_no_request_becomes_a_job(client: TestClient, beat: bytes) -> None:
    """Another replica would not know it."""
    for prefer in ("respond-async", "wait=0"):
        answer = client.post("/v1/signature", content=beat, headers={"Prefer": prefer})
        assert answer.status_code == 200


def test_every_other_call_says_that_it_needs_a_store(client: TestClient) -> None:
    document = client.get("/openapi.json").json()
    described = {
        (method.upper(), path) for path, one in document["paths"].items() for method in one
    }
    hidden = {("GET", path) for path in ("/docs", "/openapi.json", "/metrics")}
    assert described | hidden == SERVED | hidden
    id_ = "0" * 64
    n_refused = 0
    for method, path in set(SCOPE_OF) - SERVED - hidden:
        if SCOPE_OF[method, path] is Scope.TRAIN:
            continue
        real = path
        for name in (
            "sequence_id",
            "key",
            "template_id",
            "track_id",
            "images_id",
            "job_id",
            "name",
        ):
            real = real.replace(f"{{{name}}}", id_)
        answer = client.request(method, real)
        assert (answer.status_code, answer.json()["code"]) == (501, "needs_store"), path
        assert "POST /v1/signature" in answer.json()["remedy"]
        n_refused += 1
    assert n_refused > 30


def test_keys_are_needed_as_ever(client: TestClient) -> None:
    for headers in ({"Authorization": "Bearer wrong"}, {"Authorization": "Bearer mm_0_0"}):
        assert client.get("/v1/limits", headers=headers).status_code == 401


def test_it_says_what_it_is_and_who_counts(client: TestClient, shared_client: TestClient) -> None:
    assert client.get("/health/ready").json()["stateless"]
    assert not shared_client.get("/health/ready").json()["stateless"]
    answers = [client.get("/v1/limits") for _ in range(201)]
    assert answers[-1].status_code == 429
    assert answers[-1].json()["counted_by"] == "replica"


def test_each_request_is_a_line_of_the_audit_log(client: TestClient, audit: Path) -> None:
    client.get("/health/live")
    lines = [json.loads(line) for line in audit.read_text().splitlines()]
    assert [line["number"] for line in lines] == list(range(1, len(lines) + 1))
    assert len({line["audit"] for line in lines}) == 1
    assert {line["owner"] for line in lines} == {"alice", None}
    assert "/v1/signature" in {line["route"] for line in lines}


def test_two_serve_the_same_folder_and_leave_nothing(
    data_dir: Path,
    token: str,
    beat: bytes,
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    settings = {
        "STATELESS": "true",
        "READ_ONLY_DIR": str(data_dir),
        "WORKERS": "1",
        "REQUIRE_KEYS": "true",
    }
    # Short, for the sockets in it.
    mine = tmp_path_factory.mktemp("t")
    headers = {"Authorization": f"Bearer {token}"}
    replicas = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(mine))
        for number in range(2):
            one = RunningService(tmp_path / str(number), settings, log=tmp_path / f"log{number}")
            replicas.append(one.start())
        answers = [one.request("POST", "/v1/signature", beat, headers) for one in replicas]
        assert [one.status for one in answers] == [200, 200]
        assert answers[0].body == answers[1].body
        assert all(one.terminate() for one in replicas)
    assert '"route": "/v1/signature"' in (tmp_path / "log0").read_text()
    assert not (tmp_path / "0").exists()
    assert not list(mine.rglob("work"))


def test_a_start_that_nobody_could_use_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="--read-only-dir has none"):
        require_keys_to_serve(Settings(stateless=True, require_keys=True, read_only_dir=tmp_path))
    with pytest.raises(ParameterError, match="engine dask"):
        without_store(Settings(stateless=True, engine="dask"))
    assert not list(tmp_path.iterdir())
