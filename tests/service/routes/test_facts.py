"""Facts over HTTP: stated, shown, changed, audited; read where they are part of a key."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from access_parts import guarded
from fastapi.testclient import TestClient
from signing import signed

from modalmotion import Facts, SignatureParameters, simulate_ventricle
from modalmotion.formats import write_npz
from modalmotion.mesh import NO_FACTS, facts_as_json
from modalmotion.mesh.sequence import sequence_from_hdf5
from modalmotion.signature.hdf5 import signature_from_hdf5
from modalmotion.simulate import Acquisition
from modalmotion.template import GivenLandmarks
from modalmotion_service.access.scopes import Scope

HDF5 = {"Accept": "application/x-hdf5"}

# A mesh, on which landmarks are read.
MESH = simulate_ventricle(
    n_vertices=150, acquisition=Acquisition(n_frames=3), rng=np.random.default_rng(5)
).with_facts(NO_FACTS)


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def data_dir(shared_data_dir: Path) -> Path:
    return shared_data_dir


@pytest.fixture
def send(client: TestClient) -> Callable[..., Any]:
    """Send the mesh, a little larger for each number, so that it is another sequence."""

    def post(number: int, facts: Facts = NO_FACTS, **request: Any) -> Any:
        larger = MESH.vertices * (1 + number / 1000)
        body = write_npz(type(MESH)(larger, MESH.faces, times=MESH.times, unit="mm"))
        if "data" in request:
            return client.post("/v1/sequences", files={"file": body}, **request)
        if facts.stated:
            body = write_npz(
                type(MESH)(larger, MESH.faces, times=MESH.times, unit="mm", facts=facts)
            )
        return client.post("/v1/sequences", content=body, **request)

    return post


def test_facts_come_in_file_query_and_form(client: TestClient, send: Callable[..., Any]) -> None:
    facts = Facts(
        tracking="normal_displacement", period=2.0, landmarks={"apex": 3}, covariates={"age": 61}
    )
    ways = [
        send(1, facts),
        send(2, params={"tracking": "normal_displacement", "period": "2",
                        "landmarks": '{"apex": 3}', "covariates": '{"age": 61}'}),
        send(3, data={"tracking": "Normal_Displacement", "period": "2",
                      "landmark:apex": "3", "covariate:age": "61"}),
    ]  # fmt: skip
    for answer in ways:
        assert answer.status_code == 201, answer.text
        assert answer.json()["facts"] == facts_as_json(facts)
        assert client.get(answer.json()["links"]["self"]).json()["facts"] == facts_as_json(facts)
    listed = client.get("/v1/sequences", params={"limit": 3}).json()["sequences"]
    assert [one["facts"] for one in listed] == [facts_as_json(facts)] * 3
    plain = send(4).json()
    assert plain["facts"] == facts_as_json(NO_FACTS)
    # The query goes over the form, and both over the file.
    both = send(
        5, data={"tracking": "normal_displacement", "cavity": "lv"}, params={"tracking": "material"}
    )
    assert (both.json()["facts"]["tracking"], both.json()["facts"]["cavity"]) == ("material", "lv")


def test_a_known_sequence_keeps_its_facts_and_says_so(send: Callable[..., Any]) -> None:
    send(10, params={"tracking": "normal_displacement"})
    # The file is as it was sent, whatever was corrected since: what is unknown comes from it.
    again = send(10, Facts(tracking="material", cavity="lv"))
    assert again.status_code == 200
    assert (again.json()["facts"]["tracking"], again.json()["facts"]["cavity"]) == (
        "normal_displacement",
        "lv",
    )
    notes = [note["text"] for note in again.json()["reading"]["notes"]]
    assert "keeps its facts; tracking" in notes[-1]
    assert "cavity is known now too" in notes[-2]


STATEMENTS = {
    "subject": ("P 1", "P 2"),
    "label": ("normal", "dyskinesia"),
    "tracking": ("normal_displacement", "material"),
    "handedness": ("right", "left"),
    "period": ("2.0", "3.0"),
    "cavity": ("lv", "rv"),
    "modality": ("MR", "CT"),
    "landmarks": ('{"apex": 3}', '{"apex": 4}'),
    "covariates": ('{"age": 61}', '{"age": 62}'),
}


@pytest.mark.every(2)
@pytest.mark.parametrize("way", ["params", "data"])
@pytest.mark.parametrize("name", STATEMENTS)
def test_what_is_stated_with_known_content_is_filled_in_or_refused_with_the_way(
    client: TestClient, send: Callable[..., Any], way: str, name: str
) -> None:
    number = 100 + 2 * list(STATEMENTS).index(name) + (way == "data")
    first, other = STATEMENTS[name]
    link = send(number).json()["links"]["self"]

    def value() -> Any:
        kept = client.get(link).json()
        return kept[name] if name in kept else kept["facts"][name]

    unknown: tuple[Any, ...] = (None, {}, "unknown")
    assert value() in unknown
    filled = send(number, **{way: {name: first}})
    assert filled.status_code == 200
    before = value()
    assert before not in unknown
    # Said again, it is as it was; left out, it stays.
    for again in ({way: {name: first}}, {}):
        assert send(number, **again).status_code == 200
        assert value() == before
    refused = send(number, **{way: {name: other}})
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert refused.json()["differ"] == [name]
    assert value() == before
    # The remedy, followed.
    assert f"PATCH {link}" in refused.json()["remedy"]
    text = json.loads(other) if name in ("landmarks", "covariates") else other
    text = float(text) if name == "period" else text
    body = {name: text} if name in ("subject", "label") else {"facts": {name: text}}
    assert client.patch(link, json=body).status_code == 200
    assert send(number, **{way: {name: other}}).status_code == 200


def test_names_of_a_form_are_kept_and_the_query_goes_over_them(send: Callable[..., Any]) -> None:
    new = send(150, data={"label": "rest", "subject": "P 9"}, params={"label": "stress"})
    assert new.status_code == 201
    assert (new.json()["label"], new.json()["subject"]) == ("stress", "P 9")
    job = send(151, data={"label": "rest"}, headers={"Prefer": "respond-async"})
    assert job.status_code in (201, 202)
    assert send(151, params={"label": "rest"}).json()["label"] == "rest"


@pytest.mark.parametrize("name", ["labell", "file", "modes", "x" * 300])
def test_an_unknown_field_of_a_form_is_refused_as_an_unknown_parameter_is(
    client: TestClient, send: Callable[..., Any], name: str
) -> None:
    refused = send(160, data={name: "mm"})
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid_request")
    assert f"form.{name[:80]}" in refused.json()["detail"]
    assert "A form has file, parameters and" in refused.json()["detail"]
    assert send(160).status_code == 201
    client.delete(send(160).json()["links"]["self"])


@pytest.mark.parametrize("path", ["/v1/templates", "/v1/signature", "/v1/classify", "/v1/encode"])
def test_where_nothing_is_stored_a_form_names_nobody(client: TestClient, path: str) -> None:
    body = write_npz(MESH)
    for field in ("label", "subject"):
        refused = client.post(path, files={"file": body}, data={field: "rest"})
        assert (refused.status_code, refused.json()["code"]) == (422, "invalid_request")


def test_two_who_fill_in_different_labels_do_not_both_succeed(
    client: TestClient, send: Callable[..., Any]
) -> None:
    link = send(170).json()["links"]["self"]
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda n: send(170, params={"label": f"L{n}"}), range(8)))
    assert sorted(answer.status_code for answer in answers) == [200, *[409] * 7]
    (won,) = (answer.json()["label"] for answer in answers if answer.status_code == 200)
    assert client.get(link).json()["label"] == won


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tracking", "tissue"),
        ("handedness", "up"),
        ("coordinates", "XYZ"),
        ("cavity", "heart"),
        ("period", "nan"),
        ("period", "-1"),
        ("period", "0.01"),
        ("modality", "x" * 41),
        ("landmarks", "{"),
        ("landmarks", '{"apex": 150}'),
        ("landmarks", '{"apex": [0, 0, NaN]}'),
        ("landmarks", '{"apex": 1, "apex": 2}'),
        ("covariates", "[" * 20_000),
        ("covariates", '{"age": true}'),
        ("covariates", json.dumps({f"n{k}": 1 for k in range(101)})),
    ],
)
def test_a_bad_fact_is_refused(send: Callable[..., Any], name: str, value: str) -> None:
    for answer in (send(20, params={name: value}), send(20, data={name: value})):
        assert answer.status_code == 422, answer.text
        assert answer.headers["content-type"] == "application/problem+json"


def test_facts_that_contradict_each_other_are_refused_by_name(send: Callable[..., Any]) -> None:
    answer = send(21, params={"coordinates": "LPS", "handedness": "left"})
    assert answer.status_code == 422
    assert "'left' contradicts the coordinates 'LPS'" in answer.text
    twice = send(21, data={"covariate:age": ["1", "2"]})
    assert (twice.status_code, "several parts" in twice.text) == (422, True)


def test_patch_changes_what_it_names_and_null_resets(
    client: TestClient, send: Callable[..., Any]
) -> None:
    first = Facts(tracking="normal_displacement", covariates={"age": 61, "sex": "f"})
    here = send(30, first).json()["links"]["self"]
    tag = client.get(here).headers["etag"]

    def changed(**facts: Any) -> Any:
        answer = client.patch(here, json={"facts": facts})
        assert answer.status_code == 200, answer.text
        assert client.get(here).json() == answer.json()
        return answer.json()["facts"]

    assert changed() == facts_as_json(first)
    assert changed(period=1.5)["tracking"] == "normal_displacement"
    assert client.get(here).headers["etag"] != tag
    assert changed(covariates={"age": None, "height": 1.7})["covariates"] == {
        "height": 1.7,
        "sex": "f",
    }
    assert changed(tracking=None, period=None, covariates=None) == facts_as_json(NO_FACTS)
    assert client.patch(here, json={"subject": "P", "facts": {"cavity": "rv"}}).json()["subject"]
    assert client.patch(here, json={"facts": None}).json()["facts"] == facts_as_json(NO_FACTS)


@pytest.mark.parametrize(
    "facts",
    [
        {"tracking": "tissue"},
        {"colour": "red"},
        {"period": -1},
        {"period": 0.01},
        {"period": "soon"},
        {"coordinates": "RAS", "handedness": "left"},
        {"landmarks": {"apex": 150}},
        {"landmarks": {"apex": [1, 2]}},
        {"landmarks": {"apex": "7"}},
        {"landmarks": []},
        {"covariates": {"age": []}},
        {"covariates": {"age": True}},
        {"covariates": {"Age": 1, "age": 2}},
        {"covariates": {f"n{k}": 1 for k in range(101)}},
        [],
        "normal_displacement",
    ],
)
def test_a_bad_change_is_refused_and_changes_nothing(
    client: TestClient, send: Callable[..., Any], facts: Any
) -> None:
    here = send(31, Facts(tracking="normal_displacement")).json()["links"]["self"]
    before = client.get(here).json()
    answer = client.patch(here, json={"facts": facts, "subject": "nobody"})
    assert answer.status_code == 422, answer.text
    assert client.get(here).json() == before


def test_a_change_misses_results_that_read_the_fact_and_no_others(
    client: TestClient, send: Callable[..., Any], data_dir: Path
) -> None:
    here = send(40).json()["links"]["self"]
    link = signed(client, here, modes=4)
    first = client.get(link)
    assert SignatureParameters(modes=4).key in first.json()["file"]

    client.patch(here, json={"facts": {"tracking": "material", "covariates": {"age": 61}}})
    same = client.get(link)
    assert same.json()["file"] == first.json()["file"]
    assert same.json()["facts"]["tracking"] == "material"
    # It shows facts, so that what a client has is no longer all of it.
    assert same.headers["etag"] != first.headers["etag"]
    image = client.get(link, headers=HDF5)
    assert signature_from_hdf5(image.content).facts == Facts(
        tracking="material", covariates={"age": 61}
    )
    assert signature_from_hdf5(data_dir / same.json()["file"]).facts == NO_FACTS

    client.patch(here, json={"facts": {"landmarks": {"theta_zero": [30, 0, 0]}}})
    # Its parameters are those of the landmarks that it was made with: now there are others.
    assert client.get(link).json()["amplitudes"] == first.json()["amplitudes"]
    other = client.get(signed(client, here, modes=4))
    stated = GivenLandmarks(theta_zero=(30.0, 0.0, 0.0))
    assert SignatureParameters(modes=4, landmarks=stated).key in other.json()["file"]
    assert other.json()["landmarks"]["given"] == ["theta_zero"]
    assert other.json()["amplitudes"] != first.json()["amplitudes"]
    asked = client.get(signed(client, here, modes=4, landmarks={"theta_zero": [30, 0, 0]}))
    assert asked.json() == other.json()
    assert client.get(f"/v1/signatures/{other.json()['key']}/readouts").status_code == 200
    trade = client.post(f"{here}/tradeoff", json={"modes": 4, "front_modes": 4})
    assert trade.status_code == 200

    client.patch(here, json={"facts": {"landmarks": None}})
    assert signed(client, here, modes=4) == link
    kept = sequence_from_hdf5(next(data_dir.rglob(f"{here[-64:]}.h5")))
    assert kept.facts == NO_FACTS


def test_stateless_answers_carry_the_facts_that_were_sent(client: TestClient) -> None:
    body = write_npz(MESH.with_facts(Facts(tracking="normal_displacement", landmarks={"apex": 3})))
    answer = client.post("/v1/signature", content=body, params={"modality": "CT"})
    assert answer.json()["facts"]["modality"] == "CT"
    assert answer.json()["landmarks"]["given"] == ["apex"]
    image = client.post("/v1/signature", content=body, headers=HDF5)
    assert signature_from_hdf5(image.content).facts.tracking == "normal_displacement"


def test_only_who_may_write_changes_facts_and_the_log_has_names_without_values(
    tmp_path: Path,
) -> None:
    with guarded(tmp_path) as service:
        body = write_npz(MESH)
        sent = service.ask("alice", "POST", "/v1/sequences", content=body)
        here = f"/v1/sequences/{sent.json()['id']}"
        change = {"json": {"facts": {"covariates": {"illness": "unmistakable"}, "period": 2.0}}}
        assert service.ask("alice", "PATCH", here, Scope.READ, **change).status_code == 403
        assert service.ask("bob", "PATCH", here, **change).status_code == 404
        assert service.ask("alice", "PATCH", here, **change).status_code == 200
        assert service.ask("alice", "PATCH", here, **change).status_code == 200
        entries = service.ask("alice", "GET", "/v1/audit").json()["entries"]
        patches = [one for one in entries if one["method"] == "PATCH" and one["status"] == 200]
        # The second one changed nothing.
        assert [one["ids"][1:] for one in patches] == [[], ["facts.period", "facts.covariates"]]
    for path in (tmp_path / "access").rglob("*"):
        if path.is_file():
            data = path.read_bytes()
            assert b"unmistakable" not in data
            assert b"illness" not in data
