"""Clinical read-outs over HTTP."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from fastapi.testclient import TestClient
from signing import signed
from template_surfaces import MAKERS

from modalmotion.clinical import clinical_readouts
from modalmotion.formats import read_npz
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.signature.making import SignatureParameters, modal_signature


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def here(client: TestClient, beat: bytes) -> str:
    return f"/v1/signatures/{client.post('/v1/sequences', content=beat).json()['id']}/readouts"


def id_in(link: str) -> str:
    return link.split("/")[3]


def test_the_answer_is_what_the_library_reads(client: TestClient, beat: bytes, here: str) -> None:
    answer = client.get(f"{signed(client, id_in(here), modes=18)}/readouts").json()
    sequence = read_npz(beat).sequence
    signature = modal_signature(sequence, SignatureParameters(modes=18))
    own = clinical_readouts(signature, sequence)
    found, mesh = answer["from_signature"], answer["of_mesh"]
    assert answer["volume_unit"] == "ml"
    assert answer["amplitudes_per_frame"] == 54
    assert answer["intended_use"] == INTENDED_USE
    assert found["volumes"] == (own.curve.volumes * own.shown_in).tolist()
    assert found["bounds"] == (own.curve.bounds * own.shown_in).tolist()
    ejected = found["ejection_fraction"]
    assert (ejected["low"], ejected["high"]) == own.curve.share_range
    assert found["volume_change"] is None
    assert ejected["low"] <= mesh["ejection_fraction"]["value"] <= ejected["high"]
    assert found["stroke_volume"]["value"] == pytest.approx(
        found["end_diastolic_volume"]["value"] - found["end_systolic_volume"]["value"]
    )


@pytest.mark.thorough
def test_a_picture_by_accept_and_a_tag_of_each(client: TestClient, here: str) -> None:
    picture = client.get(here, headers={"Accept": "image/png"})
    assert picture.content.startswith(b"\x89PNG")
    numbers = client.get(here)
    tag = numbers.headers["etag"]
    other = client.get(f"{signed(client, id_in(here), modes=4)}/readouts")
    assert tag not in (picture.headers["etag"], other.headers["etag"])
    again = client.get(here, headers={"If-None-Match": tag})
    assert (again.status_code, again.content) == (304, b"")
    assert client.get(here, headers={"Accept": "text/html"}).status_code == 406


def test_a_cohorts_template_is_used(client: TestClient, beat: bytes, here: str) -> None:
    template = client.post("/v1/templates", content=beat).json()["id"]
    named = client.get(f"{signed(client, id_in(here), template=template)}/readouts").json()
    assert named["template_id"] == template
    own = client.get(here).json()["from_signature"]["volumes"]
    assert named["from_signature"]["volumes"] == pytest.approx(own, rel=1e-9)


def test_without_a_unit_only_the_fraction_has_a_name(
    client: TestClient, beat: bytes, npz: Callable[..., bytes]
) -> None:
    sequence = read_npz(beat).sequence
    body = npz(vertices=sequence.vertices, grid=np.array(sequence.grid), topology="cup")
    made = f"/v1/signatures/{client.post('/v1/sequences', content=body).json()['id']}"
    answer = client.get(f"{made}/readouts").json()
    assert answer["volume_unit"] == "cubed length units"
    assert answer["from_signature"]["volumes"][0] == pytest.approx(answer["of_mesh"]["volumes"][0])


def test_what_encloses_nothing_is_a_problem_with_a_remedy(
    client: TestClient, npz: Callable[..., bytes]
) -> None:
    rows, columns = np.divmod(np.arange(48.0), 8)
    sheet = np.stack([rows, columns, np.sin(rows)], axis=1)
    body = npz(vertices=np.stack([sheet, sheet * 1.1]), grid=np.array([6, 8]), topology="plane")
    made = f"/v1/signatures/{client.post('/v1/sequences', content=body).json()['id']}"
    answer = client.get(f"{made}/readouts")
    assert (answer.status_code, answer.json()["code"]) == (422, "unsupported_topology")
    assert "cavity" in answer.json()["remedy"]
    unknown = client.get(f"/v1/signatures/{'0' * 64}/readouts")
    assert (unknown.status_code, unknown.json()["code"]) == (404, "not_found")


def test_the_strain_alone_is_that_of_the_read_outs(client: TestClient, here: str) -> None:
    whole = client.get(here).json()["strain"]
    assert client.get(here.replace("readouts", "strain")).json() == whole
    assert {"GLS", "GCS", "GAS"} <= {one["name"] for one in whole["figures"]}


def test_a_stated_cavity_names_the_share_and_changes_the_tag(
    client: TestClient, npz: Callable[..., bytes]
) -> None:
    vertices, faces = MAKERS["sphere"](80, np.random.default_rng(2))
    made = client.post("/v1/sequences", content=npz(vertices=vertices, faces=faces))
    here, of = made.headers["location"], f"/v1/signatures/{made.json()['id']}"
    before = client.get(f"{of}/readouts")
    assert before.json()["from_signature"]["ejection_fraction"] is None
    changed = client.patch(here, json={"facts": {"cavity": "la"}})
    assert changed.status_code == 200, changed.text
    tag = before.headers["etag"]
    after = client.get(f"{of}/readouts", headers={"If-None-Match": tag})
    assert after.status_code == 200
    for curve in ("from_signature", "of_mesh"):
        assert after.json()[curve]["volume_change"] is None
        assert after.json()[curve]["ejection_fraction"] == before.json()[curve]["volume_change"]
