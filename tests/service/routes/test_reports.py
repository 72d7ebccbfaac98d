"""GET /v1/sequences/{id}/report: FHIR, PDF, CSV, the same bytes every time."""

from __future__ import annotations

import csv

import jsonschema
import pytest
from fastapi.testclient import TestClient
from fhir_profile import PROFILE

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def here(client: TestClient, beat: bytes) -> str:
    return str(client.post("/v1/sequences", content=beat).headers["location"])


def test_fhir_is_of_the_profile_and_the_same_bytes(client: TestClient, here: str) -> None:
    answer = client.get(f"{here}/report")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/fhir+json; fhirVersion=4.0"
    jsonschema.validate(answer.json(), PROFILE)
    assert client.get(f"{here}/report").content == answer.content
    tag = answer.headers["etag"]
    assert client.get(f"{here}/report", headers={"If-None-Match": tag}).status_code == 304
    client.patch(here, json={"facts": {"cavity": "lv", "modality": "MR"}})
    stated = client.get(f"{here}/report", headers={"If-None-Match": tag})
    assert stated.status_code == 200
    assert "http://loinc.org" in stated.text
    client.patch(here, json={"facts": {"cavity": "unknown", "modality": None}})


def test_people_and_tables_have_forms_of_their_own(client: TestClient, here: str) -> None:
    page = client.get(f"{here}/report", headers={"Accept": "application/pdf"})
    assert page.content.startswith(b"%PDF")
    table = client.get(f"{here}/report", headers={"Accept": "text/csv"})
    rows = list(csv.DictReader(table.text.splitlines()))
    readouts = client.get(f"{here}/readouts").json()
    volumes = [float(row["volume_ml"]) for row in rows]
    assert len(volumes) == readouts["n_frames"] if "n_frames" in readouts else volumes
    assert client.get(f"{here}/report", headers={"Accept": "image/png"}).status_code == 406


def test_a_kept_class_is_reported_and_another_is_not_made_up(client: TestClient, here: str) -> None:
    refused = client.get(f"{here}/report?model=ventricle-simulated")
    assert refused.status_code == 404
    assert "classifications" in refused.json()["remedy"]
    client.post(f"{here}/classifications", json={"model": "ventricle-simulated"})
    kept = client.get(f"{here}/classifications").json()["classifications"][0]
    bundle = client.get(f"{here}/report?model={kept['model']}").json()
    classes = [
        entry["resource"]
        for entry in bundle["entry"]
        if entry["resource"].get("code", {}).get("text") == "Class of motion"
    ]
    label = kept["label"]
    if label is None:
        assert "dataAbsentReason" in classes[0]
    else:
        assert classes[0]["valueCodeableConcept"]["text"] == label


def test_an_unknown_sequence_is_not_found(client: TestClient) -> None:
    assert client.get(f"/v1/sequences/{'0' * 64}/report").status_code == 404
