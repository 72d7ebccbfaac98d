"""Norms over HTTP: made of kept controls, asked as the library is asked, deleted for good."""

from __future__ import annotations

import json
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from norm_controls import beat
from training_cohort import finished

import modalmotion as mm
from modalmotion.classification import TrainingCase
from modalmotion.client import Client, RemoteError
from modalmotion.formats import write_npz
from modalmotion.mesh import Facts
from modalmotion.norm import cohort_deviation, norm_from_hdf5, train_norm
from modalmotion.simulate import MotionClass

N_CONTROLS = 10
CONTROLS = [beat(seed).with_facts(Facts(covariates={"age": 40 + seed})) for seed in range(10)]


HERE = "/v1/norms/volunteers"


@dataclass(frozen=True)
class Kept:
    client: TestClient
    data_dir: Path
    ids: list[str]
    norm: dict[str, Any]


def sent(client: TestClient, sequence: mm.MeshSequence, **names: str) -> str:
    answer = client.post("/v1/sequences", content=write_npz(sequence), params=names)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def deviations(kept: Kept, ids: list[str], norm: str = "volunteers", **more: Any) -> Any:
    return kept.client.post(f"/v1/norms/{norm}/deviations", json={"sequences": ids, **more})


# Ten controls are fitted: 2 s, once for all tests.
@pytest.fixture(scope="module")
def kept(shared_client: TestClient, shared_data_dir: Path) -> Kept:
    client = shared_client
    ids = [sent(client, one, subject=f"v-{k}") for k, one in enumerate(CONTROLS)]
    answer = client.post("/v1/norms", json={"name": "volunteers", "sequences": ids})
    assert answer.status_code == 202, answer.text
    job = finished(client, answer.json())
    assert job["state"] == "succeeded", job
    return Kept(client, shared_data_dir, ids, client.get(job["result"]).json())


def test_a_norm_of_kept_controls_is_the_librarys_own(kept: Kept) -> None:
    own = train_norm(
        [TrainingCase(one, "", f"v-{k}") for k, one in enumerate(CONTROLS)], "volunteers"
    )
    assert kept.norm == {**own.as_json(), "links": {"self": "/v1/norms/volunteers"}}
    assert kept.norm["has_volumes"]
    assert kept.norm["covariates"] == ["age"]
    here = HERE
    file = kept.client.get(here, headers={"Accept": "application/x-hdf5"})
    assert 'filename="volunteers.h5"' in file.headers["content-disposition"]
    assert norm_from_hdf5(file.content).id == own.id
    tag = kept.client.get(here).headers["etag"]
    assert kept.client.get(here, headers={"If-None-Match": tag}).status_code == 304
    listed = kept.client.get("/v1/norms").json()["norms"]
    assert listed == [{"name": "volunteers", "links": {"self": here}}]


def test_a_kept_sequence_is_compared_as_the_library_compares_it(kept: Kept) -> None:
    patient = beat(100, MotionClass.HYPOKINESIA)
    name = sent(kept.client, patient)
    answer = deviations(kept, [name], level=0.1)
    file = kept.client.get("/v1/norms/volunteers", headers={"Accept": "application/x-hdf5"})
    own = norm_from_hdf5(file.content).deviation(patient, level=0.1)
    assert answer.json()["p"] is None
    (found,) = answer.json()["deviations"]
    assert found == json.loads(json.dumps(own.as_json()))
    assert {one["name"] for one in found["quantities"]} == {one.name for one in own.quantities}
    few = deviations(kept, [name])
    assert (few.status_code, few.json()["needed"]) == (422, 19)
    assert "level of at least 0.091" in few.json()["remedy"]
    (its_own,) = deviations(kept, kept.ids[:1], level=0.1).json()["deviations"]
    assert its_own["n_controls"] == N_CONTROLS - 1


def test_recordings_are_compared_together_and_another_cohort_is_warned_of(kept: Kept) -> None:
    others = [beat(200 + k, noise=2.0) for k in range(5)]
    ids = [sent(kept.client, one) for one in others]
    with Client("http://testserver", transport=kept.client._transport) as remote:
        answer = remote.deviations(ids, "volunteers", level=0.1)
    file = kept.client.get("/v1/norms/volunteers", headers={"Accept": "application/x-hdf5"})
    own = cohort_deviation(norm_from_hdf5(file.content), others, level=0.1)
    assert answer == json.loads(json.dumps(own.as_json()))
    here = "/v1/norms/volunteers/deviations"
    few = kept.client.post(here, json={"sequences": ids[:4], "level": 0.1}).json()
    assert (len(few["deviations"]), few["p"], few["is_another"]) == (4, None, None)
    assert kept.client.post("/v1/norms/few/deviations", json={"sequences": ids}).status_code == 404


def test_what_cannot_be_a_norm_is_refused_at_once(kept: Kept) -> None:
    def refused(status: int, code: str, **body: Any) -> str:
        request = {"name": "other", "sequences": kept.ids, **body}
        answer = kept.client.post("/v1/norms", json=request)
        assert (answer.status_code, answer.json()["code"]) == (status, code), answer.text
        return str(answer.json().get("remedy"))

    assert "DELETE /v1/norms/volunteers" in refused(409, "conflict", name="volunteers")
    refused(404, "not_found", sequences=["0" * 64])
    refused(422, "invalid_request", name="Not A Name")
    refused(422, "invalid_request", modes=0)
    few = kept.client.post("/v1/norms", json={"name": "few", "sequences": kept.ids[:8]})
    job = finished(kept.client, few.json())
    assert job["state"] == "failed"
    assert "at least 9" in job["error"]["remedy"]
    for method, path in (("GET", "few"), ("DELETE", "few"), ("GET", "Few")):
        assert kept.client.request(method, f"/v1/norms/{path}").status_code in (404, 422)
    assert deviations(kept, kept.ids[:1], norm="few").status_code == 404
    assert kept.client.post(f"{HERE}/deviations").status_code == 422
    assert deviations(kept, ["0" * 64]).status_code == 404


def test_the_client_makes_asks_and_deletes_norms(kept: Kept, tmp_path: Path) -> None:
    with Client("http://testserver", transport=kept.client._transport) as remote:
        made = remote.make_norm("second", kept.ids, modes=5)
        assert made["n_modes"] < kept.norm["n_modes"]
        assert remote.norm("second") == made
        assert remote.norms() == ["second", "volunteers"]
        remote.save("norm", tmp_path / "second.h5", "second")
        assert norm_from_hdf5(tmp_path / "second.h5").id == made["id"]
        (found,) = remote.deviations([kept.ids[3]], "second", level=0.1)["deviations"]
        assert found["norm_id"] == made["id"]
        remote.delete_norm("second")
        with pytest.raises(RemoteError, match="no norm named 'second'"):
            remote.norm("second")
        # The name is free, and the file of the one before does not stand in its way.
        again = remote.make_norm("second", kept.ids)
        assert again["n_modes"] == kept.norm["n_modes"]
        remote.delete_norm("second")
    assert not list(kept.data_dir.rglob("second*"))


@pytest.mark.thorough
def test_two_norms_of_one_name_made_at_once_end_as_one(kept: Kept) -> None:
    bodies = [{"name": "raced", "sequences": kept.ids, "modes": n} for n in (3, 4)]
    jobs: list[Any] = []

    def start(body: dict[str, Any]) -> None:
        jobs.append(kept.client.post("/v1/norms", json=body).json())

    threads = [threading.Thread(target=start, args=(body,)) for body in bodies]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    ends = [finished(kept.client, job) if "id" in job else {"state": "failed"} for job in jobs]
    assert sorted(end["state"] for end in ends) == ["failed", "succeeded"]
    assert kept.client.delete("/v1/norms/raced").status_code == 204
