"""Unit and times stated later: another sequence takes the place of the old one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from clouds import small_recording
from fastapi.testclient import TestClient

from modalmotion.formats import write_npz
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.simulate import Acquisition, simulate_ventricle

BEAT = simulate_ventricle(
    n_vertices=150, acquisition=Acquisition(n_frames=4), rng=np.random.default_rng(8)
)
UNTIMED = mesh_sequence(BEAT.vertices, BEAT.faces)


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture
def send(client: TestClient) -> Callable[..., str]:
    """Send the beat, a little larger for each number, so that it is another sequence."""

    def post(number: int, **query: str) -> str:
        larger = MeshSequence(UNTIMED.vertices * (1 + number / 1000), UNTIMED.faces)
        answer = client.post("/v1/sequences", content=write_npz(larger), params=query)
        assert answer.status_code == 201, answer.text
        return str(answer.json()["links"]["self"])

    return post


def test_unit_and_times_make_another_sequence_that_takes_the_place_of_the_old(
    client: TestClient, send: Callable[..., str]
) -> None:
    old = send(1, subject="S1", label="normal", cavity="lv")
    client.patch(old, json={"name": "beat of Monday.npz"})
    client.get(f"/v1/signatures/{old.rpartition('/')[2]}/readouts")
    times = [0.0, 0.2, 0.45, 0.6]
    answer = client.patch(old, json={"unit": "mm", "times": times, "facts": {"period": 0.8}})
    assert answer.status_code == 200, answer.text
    said = answer.json()
    new = said["links"]["self"]
    assert new != old
    assert answer.headers["content-location"] == new
    kept = (said["name"], said["subject"], said["label"], said["facts"]["cavity"])
    assert kept == ("beat of Monday.npz", "S1", "normal", "lv")
    assert (said["unit"], said["facts"]["period"]) == ("mm", 0.8)
    assert client.get(old).status_code == 404
    assert client.get(f"/v1/signatures/{old.rpartition('/')[2]}/readouts").status_code == 404
    # The same sequence as one that was sent with both.
    larger = MeshSequence(UNTIMED.vertices * 1.001, UNTIMED.faces).with_unit("mm")
    assert said["id"] == larger.with_times(times).id
    assert client.get(f"/v1/signatures/{said['id']}/readouts").json()["volume_unit"] == "ml"
    # And back: what is taken away gives the old one again.
    back = client.patch(new, json={"unit": None, "times": None, "facts": {"period": None}})
    assert back.json()["links"]["self"] == old
    assert client.get(new).status_code == 404


def test_what_it_is_already_changes_nothing(client: TestClient, send: Callable[..., str]) -> None:
    link = send(2, unit="mm")
    said = client.patch(link, json={"unit": "mm", "subject": "S2"}).json()
    assert (said["links"]["self"], said["subject"]) == (link, "S2")


@pytest.mark.parametrize(
    "change",
    [
        {"unit": "parsec"},
        {"times": [0.0, 1.0]},
        {"times": [0.0, 1.0, 0.5, 2.0]},
        {"times": [0.0, 1.0, 2.0, 3.0], "facts": {"period": 0.5}},
        {"name": "a\nb"},
    ],
)
def test_a_bad_statement_leaves_everything_as_it_was(
    client: TestClient, send: Callable[..., str], change: dict[str, object]
) -> None:
    link = send(3 + len(str(change)))
    before = client.get(link).json()
    n = len(client.get("/v1/sequences?limit=1000").json()["sequences"])
    answer = client.patch(link, json=change)
    assert 400 <= answer.status_code < 500, answer.text
    assert client.get(link).json() == before
    assert len(client.get("/v1/sequences?limit=1000").json()["sequences"]) == n


def test_a_track_keeps_its_errors_and_its_data(
    client: TestClient,
) -> None:
    sent = client.post("/v1/tracks", content=small_recording(), params={"modes": "4"})
    assert sent.status_code == 201, sent.text
    old = sent.json()["links"]["self"]
    before = client.get(old).json()
    n = len(before["residual_rms"])
    change = {"times": [0.1 * k for k in range(n)]}
    answer = client.patch(f"/v1/sequences/{old.rpartition('/')[2]}", json=change)
    assert answer.status_code == 200, answer.text
    new = f"/v1/tracks/{answer.json()['id']}"
    after = client.get(new).json()
    for name in ("residual_rms", "deviation_across", "inliers", "coverage", "notes"):
        assert after[name] == before[name], name
    assert client.get(old).status_code == 404
    view = {"Accept": "application/vnd.modalmotion.view"}
    assert client.get(new, headers=view).status_code == 200


def test_a_name_is_listed_deleted_with_its_sequence_and_never_logged(
    client: TestClient,
    send: Callable[..., str],
    shared_data_dir: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    link = send(900)
    with caplog.at_level("DEBUG"):
        assert client.patch(link, json={"name": "Ms Quux.nii.gz"}).status_code == 200
        listed = client.get("/v1/sequences?limit=1").json()["sequences"]
    assert listed[0]["name"] == "Ms Quux.nii.gz"
    assert "Quux" not in caplog.text

    def holders() -> list[Path]:
        return [
            path
            for path in shared_data_dir.rglob("*")
            if path.is_file() and b"Quux" in path.read_bytes()
        ]

    assert holders()
    assert client.delete(link).status_code == 204
    assert not holders()
