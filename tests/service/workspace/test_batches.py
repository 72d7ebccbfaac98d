"""Many files in one request: each has its own answer, and none is lost by another."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from httpx2 import Response
from job_requests import finished

from modalmotion.errors import StoreError
from modalmotion.formats import read_npz
from modalmotion_service.errors import WorkerDiedError
from modalmotion_service.workspace import file_operations

MODES = "modes=3"


@pytest.fixture(scope="module")
def files(beat: bytes) -> list[tuple[str, bytes]]:
    """Two beats, and between them a file that is none."""
    sequence = read_npz(beat).sequence
    buffer = io.BytesIO()
    np.savez(buffer, vertices=sequence.vertices[1:], grid=(8, 16), topology="cup", unit="mm")
    return [("a.npz", beat), ("broken.npz", b"nothing"), ("b.npz", buffer.getvalue())]


def sent(
    client: TestClient,
    files: list[tuple[str, bytes]],
    path: str = f"signature?{MODES}",
    accept: str = "application/json",
    prefer: str = "",
    **fields: str,
) -> Response:
    parts = [("files", (name, data, "application/octet-stream")) for name, data in files]
    headers = {"Accept": accept} | ({"Prefer": prefer} if prefer else {})
    return client.post(f"/v1/{path}", files=parts, data=fields, headers=headers)


def alone(client: TestClient, data: bytes, path: str = f"signature?{MODES}") -> dict[str, Any]:
    answer: dict[str, Any] = client.post(f"/v1/{path}", content=data).json()
    return answer


def codes(answer: Response) -> list[str | None]:
    return [one["error"] and one["error"]["code"] for one in answer.json()["results"]]


def in_spool(data_dir: Path) -> list[Path]:
    return list((data_dir / "spool").iterdir())


@pytest.mark.parametrize(
    ("path", "member"), [(f"signature?{MODES}", "signature"), ("classify", "classification")]
)
def test_each_has_the_answer_that_it_has_alone(
    shared_client: TestClient,
    shared_data_dir: Path,
    files: list[tuple[str, bytes]],
    path: str,
    member: str,
) -> None:
    answer = sent(shared_client, files, path)
    assert (answer.status_code, answer.headers["batch-failed"]) == (200, "1")
    first, broken, last = answer.json()["results"]
    assert answer.json()["n_failed"] == 1
    assert [one["name"] for one in (first, broken, last)] == [name for name, _ in files]
    assert first == {
        "name": "a.npz",
        "subject": None,
        "label": None,
        "error": None,
        member: alone(shared_client, files[0][1], path),
    }
    assert last[member] == alone(shared_client, files[2][1], path)
    assert broken[member] is None
    assert broken["error"] == alone(shared_client, files[1][1], path)
    lines = sent(shared_client, files, path, "application/x-ndjson").text.splitlines()
    assert [json.loads(line) for line in lines] == [first, broken, last]
    assert not in_spool(shared_data_dir)


def test_where_all_fail_all_are_named(shared_client: TestClient) -> None:
    answer = sent(shared_client, [("x", b"1"), ("y", b"2")])
    assert (answer.status_code, answer.headers["batch-failed"]) == (200, "2")


def test_a_manifest_says_what_each_is(shared_client: TestClient, beat: bytes) -> None:
    files = [("a.npz", beat), ("b.npz", beat)]
    manifest = "path;subject;label;age\r\nb.npz;P 2;patient;61\r\na.npz;P 1;control;\r\n"
    found = sent(shared_client, files, manifest=manifest, **{"covariate:age": "50"}).json()[
        "results"
    ]
    assert [(one["subject"], one["label"]) for one in found] == [
        ("P 1", "control"),
        ("P 2", "patient"),
    ]
    told = [one["signature"]["facts"]["covariates"] for one in found]
    assert told == [{"age": 50.0}, {"age": 61.0}]


@pytest.mark.parametrize(
    ("manifest", "words"),
    [
        ("path\na.npz\n", "'b.npz' is 0 times in the manifest"),
        ("path\na.npz\nb.npz\nc.npz\n", "'c.npz'"),
        ("path\na.npz\na.npz\n", "'a.npz' is 2 times in the manifest"),
        ("path,label\na.npz," + "x" * 300 + "\nb.npz,y\n", "Line 2 of 'manifest'"),
        ("name\na.npz\n", "no column 'path'"),
    ],
)
def test_a_manifest_that_does_not_fit_is_refused(
    shared_client: TestClient, shared_data_dir: Path, manifest: str, words: str
) -> None:
    answer = sent(shared_client, [("a.npz", b"1"), ("b.npz", b"2")], manifest=manifest)
    assert answer.status_code in (400, 422)
    assert words in answer.json()["detail"]
    assert not in_spool(shared_data_dir)


def test_a_manifest_that_is_not_utf8_says_how_to_save_it(shared_client: TestClient) -> None:
    for table in ("path\nschw\u00e4che.npz\n".encode("latin-1"), "path\na.npz\n".encode("utf-16")):
        parts = [("files", ("a.npz", b"1")), ("manifest", ("m.csv", table))]
        answer = shared_client.post("/v1/signature", files=parts)
        assert answer.status_code in (400, 422)
        assert "not UTF-8 text" in answer.json()["detail"]
        assert "CSV UTF-8" in answer.text


def test_what_a_form_may_not_have_is_refused(shared_client: TestClient, beat: bytes) -> None:
    both = [("files", ("a", beat)), ("file", ("b", beat))]
    twice = [("file", ("a", beat)), ("file", ("b", beat))]
    for parts, path in ((both, "signature"), (twice, "signature"), (both, "templates")):
        answer = shared_client.post(f"/v1/{path}", files=parts)
        assert answer.status_code in (400, 422)
    assert "parts named 'files'" in shared_client.post("/v1/classify", files=twice).text


def test_more_than_the_limit_are_refused(
    shared_client: TestClient, shared_data_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    owners = shared_client.app.state.owners  # type: ignore[attr-defined]
    few = owners.local.settings.model_copy(update={"max_batch_files": 2})
    monkeypatch.setattr(owners, "_states", {"local": replace(owners.local, settings=few)})
    answer = sent(shared_client, [(str(n), b"1") for n in range(3)])
    assert (answer.status_code, answer.json()["limit"]) == (413, "batch_files")
    assert sent(shared_client, [(str(n), b"1") for n in range(2)]).status_code == 200
    assert not in_spool(shared_data_dir)


def test_a_job_gives_the_same(
    shared_client: TestClient, shared_data_dir: Path, files: list[tuple[str, bytes]]
) -> None:
    job = sent(shared_client, files, prefer="respond-async")
    assert job.status_code == 202
    done = finished(shared_client, job.json())
    answer = shared_client.get(done["result"])
    assert answer.json()["results"] == sent(shared_client, files).json()["results"]
    assert answer.headers["batch-failed"] == "1"
    shared_client.delete(f"/v1/jobs/{done['id']}")


def test_a_fault_of_a_file_is_its_own_and_one_of_the_machine_is_of_all(
    shared_client: TestClient, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = file_operations._signed
    fault: Exception = WorkerDiedError("It died.", remedy="Send another.")

    async def faulty(state: Any, upload: Any, *rest: Any) -> Any:
        if upload.part.name == "bad":
            raise fault
        return await fit(state, upload, *rest)

    monkeypatch.setattr(file_operations, "_signed", faulty)
    files = [("a", beat), ("bad", beat), ("c", beat)]
    assert codes(sent(shared_client, files)) == [None, "worker_died", None]
    fault = RuntimeError("a bug")
    assert codes(sent(shared_client, files)) == [None, "internal_error", None]
    fault = StoreError("The disk is gone.", remedy="Bring it back.")
    assert sent(shared_client, files).status_code == 503


def test_many_files_go_in_their_order_whatever_their_sizes(
    shared_client: TestClient, shared_data_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def told(_state: Any, upload: Any, *_: Any) -> Any:
        return json.dumps(upload.data().hex()).encode()

    monkeypatch.setattr(file_operations, "_signed", told)
    rng = np.random.default_rng(3)
    # Parts end within a piece of the body, and within one of those that are written.
    files = [(str(n), rng.bytes(n)) for n in (0, 1, 70_000, 3, 65_536, 2, 200_000)]
    found = sent(shared_client, files).json()["results"]
    assert [(one["name"], bytes.fromhex(one["signature"])) for one in found] == files
