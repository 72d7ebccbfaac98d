"""GET /v1/signatures/{id}/report: FHIR, PDF, CSV, the same bytes every time."""

from __future__ import annotations

import csv
import io
import json
import logging
import zipfile
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from dicom_samples import study_instance
from fastapi.testclient import TestClient
from fhir_profile import PROFILE
from norm_controls import beat as norm_beat
from signing import signed

import modalmotion as mm
from modalmotion.classification import classify
from modalmotion.client import Client
from modalmotion.errors import ParameterError
from modalmotion.exports.tables import frame_table
from modalmotion.formats import write_npz
from modalmotion.formats.parser_child import ParserHere
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.reports import fhir_json, report_figure, report_of
from modalmotion.reports.dicom import dicom_instances, read_study
from modalmotion.representation import probability
from modalmotion.simulate import MotionClass
from modalmotion_service.schemas.results import ReadoutsAnswer

pytest.importorskip("matplotlib")
pydicom = pytest.importorskip("pydicom")


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def sequence(client: TestClient, beat: bytes) -> str:
    return str(client.post("/v1/sequences", content=beat).headers["location"])


@pytest.fixture(scope="module")
def here(client: TestClient, sequence: str) -> str:
    return signed(client, sequence)


def test_fhir_is_of_the_profile_and_the_same_bytes(
    client: TestClient, sequence: str, here: str
) -> None:
    answer = client.get(f"{here}/report")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/fhir+json; fhirVersion=4.0"
    jsonschema.validate(answer.json(), PROFILE)
    assert client.get(f"{here}/report").content == answer.content
    tag = answer.headers["etag"]
    assert client.get(f"{here}/report", headers={"If-None-Match": tag}).status_code == 304
    client.patch(sequence, json={"facts": {"cavity": "lv", "modality": "MR"}})
    stated = client.get(f"{here}/report", headers={"If-None-Match": tag})
    assert stated.status_code == 200
    assert "http://loinc.org" in stated.text
    client.patch(sequence, json={"facts": {"cavity": "unknown", "modality": None}})


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
    assert client.get(f"/v1/signatures/{'0' * 64}/report").status_code == 404


@pytest.fixture(scope="module")
def placed(client: TestClient) -> str:
    """A sequence whose coordinates are stated to be LPS, in mm."""
    body = write_npz(replace(norm_beat(5), unit="mm"))
    here = str(client.post("/v1/sequences", content=body).headers["location"])
    client.patch(here, json={"facts": {"coordinates": "LPS", "cavity": "lv", "modality": "MR"}})
    return signed(client, here)


# A worker loads highdicom: 1 s.
def test_dicom_objects_have_the_numbers_of_the_readouts_and_nothing_of_the_patient_stays(
    client: TestClient, placed: str, shared_data_dir: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("highdicom")
    caplog.set_level(logging.DEBUG)
    study = study_instance()
    answer = client.post(f"{placed}/dicom", content=study)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/zip"
    assert client.post(f"{placed}/dicom", content=study).content == answer.content
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        assert archive.namelist() == ["report.dcm", "end-diastole.dcm", "end-systole.dcm"]
        numbers = numbers_of(archive.read("report.dcm"))
    volumes = client.get(f"{placed}/readouts").json()["from_signature"]
    assert numbers["10230-1"] == volumes["ejection_fraction"]["value"]
    kept = b"".join(path.read_bytes() for path in shared_data_dir.rglob("*") if path.is_file())
    for secret in ("ller^J", "1.2.3.4.5"):
        assert secret.encode() not in kept
        assert secret not in caplog.text


def test_dicom_without_a_space_or_a_study_is_refused(
    client: TestClient, here: str, placed: str
) -> None:
    pytest.importorskip("highdicom")
    nowhere = client.post(f"{here}/dicom", content=study_instance())
    assert (nowhere.status_code, nowhere.json()["fact"]) == (422, "coordinates")
    none = client.post(f"{placed}/dicom", content=b"no DICOM")
    assert none.status_code == 400
    assert "instance of the study" in none.json()["remedy"]
    wrong = client.post(f"{placed}/dicom", content=study_instance(PatientID="secret" * 40))
    assert wrong.status_code == 400
    assert "secret" not in wrong.text
    assert client.post(f"{placed}/dicom?model=nobody", content=b"x").status_code == 404
    unknown = f"/v1/signatures/{'0' * 64}/dicom"
    assert client.post(unknown, content=study_instance()).status_code == 404


def test_the_client_saves_reports_and_objects(
    client: TestClient, placed: str, tmp_path: Path
) -> None:
    pytest.importorskip("highdicom")
    name = placed.rsplit("/", 1)[-1]
    with Client("http://testserver", transport=client._transport) as remote:
        for file, begins in (("a.json", b"{"), ("a.csv", b"frame")):
            remote.save("report", tmp_path / file, name)
            assert (tmp_path / file).read_bytes().startswith(begins)
        remote.save_dicom(name, study_instance(), tmp_path / "a.zip")
        assert (tmp_path / "a.zip").read_bytes().startswith(b"PK")
        with pytest.raises(ParameterError, match="suffix"):
            remote.save("report", tmp_path / "a.doc", name)


# highdicom and the shipped model are loaded, and a page is drawn for each class: 3 s.
def test_all_forms_say_the_same_to_the_last_printed_digit() -> None:
    pytest.importorskip("highdicom")
    parser = ParserHere(DEFAULT_LIMITS)
    study = read_study(study_instance(), parser=parser)
    n_classes = 0
    for seed, label in enumerate(MotionClass):
        sequence = norm_beat(seed, label)
        facts = replace(sequence.facts, coordinates="LPS", cavity="lv")
        sequence = replace(sequence, unit="mm", facts=facts)
        signature = mm.modal_signature(sequence, mm.SignatureParameters(modes=7))
        answer = classify(sequence)
        n_classes += answer.label is not None
        issued = datetime(2026, 1, 31, tzinfo=UTC)
        report = report_of(signature, sequence, issued=issued, classification=answer)
        assert report.readouts is not None
        assert report.ventricle is not None
        said = ReadoutsAnswer.of(report.readouts, report.ventricle)
        json_form = json.loads(said.model_dump_json())["from_signature"]
        bundle = json.loads(fhir_json(report))
        fhir = {
            part["code"]["coding"][-1]["code"]: part["valueQuantity"]["value"]
            for entry in bundle["entry"]
            for part in entry["resource"].get("component", ())
        }
        file = dicom_instances(report, study)["report.dcm"]
        sr = numbers_of(file)
        text = frame_table(signature, report.readouts, report.ventricle).to_csv()
        volumes = [float(row["volume_ml"]) for row in csv.DictReader(text.splitlines())]
        page = "\n".join(one.get_text() for one in report_figure(report).texts)
        in_csv = {
            "ejection_fraction": None,
            "end_diastolic_volume": max(volumes),
            "end_systolic_volume": min(volumes),
        }
        for name, in_table in in_csv.items():
            code, value = name.replace("_", "-"), json_form[name]["value"]
            for end in ("low", "high"):
                both = fhir[f"{code}-{end}"], sr[f"{code}-{end}"]
                assert both == (json_form[name][end],) * 2, (seed, name, end)
            assert fhir[code] == sr[code] == value, (seed, name)
            assert in_table in (None, value), (seed, name)
            assert f"{value:.1f} " in page, (seed, name)
        classes = [
            entry["resource"].get("valueCodeableConcept", {}).get("text")
            for entry in bundle["entry"]
            if entry["resource"].get("code", {}).get("text") == "Class of motion"
        ]
        assert classes == [answer.label]
        if answer.label is not None:
            assert f"{answer.label}, probability {probability(answer.probability)}" in page
            assert answer.label in str(pydicom.dcmread(io.BytesIO(file)))
            assert answer.probability in sr.values()
    assert n_classes


def numbers_of(sr: bytes) -> dict[str, float]:
    """Every number of a structured report by its code; of several the first."""
    found: dict[str, float] = {}

    def walk(item: Any) -> None:
        if item.get("ValueType") == "NUM":
            name = item.ConceptNameCodeSequence[0]
            code = name.get("CodeValue") or name.get("LongCodeValue")
            number = item.MeasuredValueSequence[0].FloatingPointValue
            found[code if code not in found else f"{code} {len(found)}"] = number
        for child in item.get("ContentSequence", ()):
            walk(child)

    walk(pydicom.dcmread(io.BytesIO(sr)))
    return found
