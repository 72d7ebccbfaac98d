"""Listing, naming, deleting, and answers that a client has already."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from urllib.parse import unquote_to_bytes

import numpy as np
import pytest
from fastapi.testclient import TestClient
from signing import signed

from modalmotion.formats import read_npz, write_npz


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def data_dir(shared_data_dir: Path) -> Path:
    return shared_data_dir


@pytest.fixture
def send(client: TestClient, npz: Callable[..., bytes]) -> Callable[..., str]:
    """Send a small sequence; those of a seed are one."""

    def post(seed: int, **query: str) -> str:
        vertices = np.random.default_rng(seed).normal(size=(3, 16, 3))
        body = npz(vertices=vertices, grid=(4, 4), topology="cup")
        return str(client.post("/v1/sequences", content=body, params=query).json()["id"])

    return post


def test_sequences_are_listed_by_page_and_filter(
    client: TestClient, send: Callable[..., str]
) -> None:
    ids = [send(seed, subject=f"s{seed % 2}", label="beat") for seed in range(100, 105)]
    first = client.get("/v1/sequences", params={"limit": 3}).json()
    rest = client.get("/v1/sequences", params={"cursor": first["cursor"]}).json()
    listed = [item["id"] for item in first["sequences"] + rest["sequences"]]
    # Behind what other tests have sent before.
    assert listed[:5] == ids[::-1]
    assert rest["cursor"] is None
    odd = client.get("/v1/sequences", params={"subject": "s1"}).json()["sequences"]
    assert [item["id"] for item in odd] == [ids[3], ids[1]]
    assert not client.get("/v1/sequences", params={"label": "other"}).json()["sequences"]
    assert client.get("/v1/sequences", params={"cursor": "nonsense"}).status_code == 422


def test_names_are_changed_and_taken_away(client: TestClient, send: Callable[..., str]) -> None:
    here = f"/v1/sequences/{send(1, subject='old', label='beat')}"
    assert client.patch(here, json={"subject": "new"}).json()["subject"] == "new"
    assert client.get(here).json()["label"] == "beat"
    assert client.patch(here, json={"label": None}).json()["label"] is None
    assert client.patch(here, json={"colour": "red"}).status_code == 422
    assert client.patch("/v1/sequences/" + "0" * 64, json={}).status_code == 404


def test_from_the_mean_shape_it_does_not_matter_where_a_recording_starts(
    client: TestClient, beat: bytes
) -> None:
    sequence = read_npz(beat).sequence
    turned = np.roll(np.arange(sequence.n_frames), -9)
    later = write_npz(replace(sequence, vertices=sequence.vertices[turned], times=None))
    found = []
    for body in (write_npz(replace(sequence, times=None)), later):
        sequence_id = client.post("/v1/sequences", content=body).json()["id"]
        here = f"/v1/sequences/{sequence_id}/signatures"
        answer = client.post(here, json={"reference": "mean"}).json()
        assert answer["parameters"]["reference"] == "mean"
        # Amplitudes are in the pose of the first frame; their sizes are in none.
        found.append(np.array(answer["deformation_spectrum"]))
    assert found[0] == pytest.approx(found[1], rel=1e-6, abs=1e-6 * found[0].max())
    for wrong in ("first", "-1", "1.5"):
        refused = client.post(here, json={"reference": wrong})
        assert refused.status_code == 422
        assert refused.json()["remedy"]


def test_deleting_takes_everything_that_derives_from_it(
    client: TestClient, send: Callable[..., str], data_dir: Path
) -> None:
    kept, gone = send(1), send(2)
    for sequence_id in (kept, gone):
        client.get(f"/v1/sequences/{sequence_id}/signature")
    assert client.delete(f"/v1/sequences/{gone}").status_code == 204
    assert client.get(f"/v1/sequences/{gone}").status_code == 404
    assert client.get(f"/v1/sequences/{gone}/signature").status_code == 404
    assert client.delete(f"/v1/sequences/{gone}").status_code == 404
    assert not [path for path in data_dir.rglob("*") if gone in path.name]
    assert client.get(f"/v1/sequences/{kept}/signature").status_code == 200


def test_what_a_client_has_is_not_sent_again(client: TestClient, send: Callable[..., str]) -> None:
    here = f"/v1/sequences/{send(1)}"
    for path in (here, f"{here}/signature"):
        first = client.get(path)
        tag = first.headers["etag"]
        again = client.get(path, headers={"If-None-Match": f'"other", W/{tag}'})
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
        assert client.get(path, headers={"If-None-Match": '"other"'}).status_code == 200
    before = client.get(here).headers["etag"]
    client.patch(here, json={"label": "new"})
    assert client.get(here, headers={"If-None-Match": before}).status_code == 200
    json_tag = client.get(f"{here}/signature").headers["etag"]
    hdf5 = client.get(
        f"{here}/signature",
        headers={"Accept": "application/x-hdf5", "If-None-Match": json_tag},
    )
    assert hdf5.status_code == 200


def test_a_request_sent_again_is_answered_as_the_first_time(
    fresh_client: TestClient, beat: bytes
) -> None:
    key = {"Idempotency-Key": "one"}
    first = fresh_client.post("/v1/sequences", content=beat, headers=key)
    again = fresh_client.post("/v1/sequences", content=beat, headers=key)
    assert (first.status_code, again.status_code) == (201, 201)
    assert again.content == first.content
    assert again.headers["location"] == first.headers["location"]
    assert again.headers["idempotency-replayed"] == "true"
    other = fresh_client.post("/v1/sequences", content=beat + b"x", headers=key)
    assert (other.status_code, other.json()["code"]) == (422, "idempotency_mismatch")
    differently = fresh_client.post("/v1/sequences?label=x", content=beat, headers=key)
    assert differently.json()["code"] == "idempotency_mismatch"


def test_a_kept_answer_states_names_and_facts_as_they_are_now(
    fresh_client: TestClient, beat: bytes
) -> None:
    send = partial(
        fresh_client.post,
        "/v1/sequences?subject=P7&label=rest&modality=mri",
        content=beat,
        headers={"Idempotency-Key": "named"},
    )
    first = send().json()
    here = first["links"]["self"]
    change = {"subject": "P8", "label": None, "facts": {"modality": "cine", "cavity": "lv"}}
    changed = fresh_client.patch(here, json=change)
    assert changed.status_code == 200, changed.text
    now = {name: changed.json()[name] for name in ("name", "subject", "label", "facts")}
    assert now["facts"]["modality"] == "cine"
    # The rest is as it was answered, with what was read beside the sequence.
    assert send().json() == {**first, **now}


def test_a_refused_request_does_not_use_up_its_key(fresh_client: TestClient, beat: bytes) -> None:
    key = {"Idempotency-Key": "two"}
    assert fresh_client.post("/v1/sequences", content=b"nonsense", headers=key).status_code == 400
    assert fresh_client.post("/v1/sequences", content=beat, headers=key).status_code == 201


def test_one_job_however_often_it_is_asked_for_with_a_key(client: TestClient, beat: bytes) -> None:
    headers = {"Idempotency-Key": "three", "Prefer": "respond-async"}
    first = client.post("/v1/sequences", content=beat, headers=headers)
    again = client.post("/v1/sequences", content=beat, headers=headers)
    assert (first.status_code, again.status_code) == (202, 202)
    assert first.json()["id"] == again.json()["id"]


def test_many_at_once_make_one_result(
    fresh_client: TestClient, beat: bytes, fresh_data_dir: Path
) -> None:
    here = fresh_client.post("/v1/sequences", content=beat).headers["location"]
    answers: list[bytes] = []

    def ask() -> None:
        answers.append(fresh_client.post(f"{here}/signatures", json={"modes": 18}).content)

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(answers)) == 1
    assert len(list((fresh_data_dir / "signatures").rglob("*.h5"))) == 1


def test_every_answer_has_an_id_and_its_times(fresh_client: TestClient, beat: bytes) -> None:
    answer = fresh_client.post("/v1/sequences", content=beat, headers={"X-Request-ID": "abc-1"})
    assert answer.headers["x-request-id"] == "abc-1"
    stages = {entry.split(";")[0].strip() for entry in answer.headers["server-timing"].split(",")}
    assert {"receive", "worker", "store", "other", "total"} <= stages
    # Each is counted once: together they are what was waited.
    *parts, total = (
        float(entry.rpartition("=")[2]) for entry in answer.headers["server-timing"].split(",")
    )
    assert sum(parts) == pytest.approx(total, abs=0.1 * len(parts))
    missing = fresh_client.get("/nowhere", headers={"X-Request-ID": "bad id\x7f"})
    assert len(missing.headers["x-request-id"]) == 16


@pytest.mark.parametrize("ranges", ["bytes=0-9", "bytes=9999999-", "nonsense", "bytes=5-2"])
def test_answers_come_whole(client: TestClient, send: Callable[..., str], ranges: str) -> None:
    here = signed(client, send(1))
    for path, accept in ((here, "application/x-hdf5"), (f"{here}/reconstruction", "*/*")):
        headers = {"Accept": accept}
        whole = client.get(path, headers=headers)
        answer = client.get(path, headers={**headers, "Range": ranges})
        assert (answer.status_code, len(answer.content)) == (200, len(whole.content))
        assert answer.headers.get("accept-ranges", "none") == "none"


@pytest.mark.parametrize("name", ["subject", "label"])
@pytest.mark.parametrize("sent", ["a%FFb", "a%E2%80%AEb", "a%E2%81%A6b", "%EF%BF%BD", "%00"])
def test_names_that_do_not_show_what_they_hold_are_not_kept(
    client: TestClient, send: Callable[..., str], npz: Callable[..., bytes], name: str, sent: str
) -> None:
    here = f"/v1/sequences/{send(1)}"
    body = npz(vertices=np.random.default_rng(2).normal(size=(3, 16, 3)), grid=(4, 4))
    answer = client.post(f"/v1/sequences?{name}={sent}", content=body)
    assert (answer.status_code, bool(answer.json()["remedy"])) == (422, True)
    text = unquote_to_bytes(sent).decode("utf-8", "replace")
    assert client.patch(here, json={name: text}).status_code == 422
    # Joiners are part of words.
    assert client.patch(here, json={name: "می\u200cخواهم"}).status_code == 200
