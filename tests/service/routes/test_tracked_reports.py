"""POST /v1/tracks?report=true: from images to a report as one job, which ends with its track."""

from __future__ import annotations

import asyncio
import io
import json
import threading
import time
import zipfile
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from ellipsoid_images import LANDMARKS, planes
from fastapi.testclient import TestClient
from fhir_profile import PROFILE
from services import served, small_settings
from training_cohort import finished

from modalmotion.client import Client
from modalmotion.formats.volumes import write_nifti_zip
from modalmotion.images import ImageSequence
from modalmotion_service.workspace import recording_operations

pytest.importorskip("nibabel")
pytest.importorskip("matplotlib")

PLACES = {"landmarks": {name: list(place) for name, place in LANDMARKS.items()}}


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def phantom() -> bytes:
    frames = tuple(planes(radius) for radius in (22.0, 18.0))
    return write_nifti_zip(ImageSequence(frames, np.array([0.0, 0.4])))


# A phantom is tracked, classified, and drawn: 3 s.
def test_the_whole_road_is_one_job(client: TestClient, phantom: bytes, tmp_path: Path) -> None:
    with Client("http://testserver", transport=client._transport) as remote:
        remote.save_tracked_report(
            phantom,
            tmp_path / "report.zip",
            landmarks=PLACES["landmarks"],
            modes=7,
            model="ventricle-simulated",
        )
    (job,) = client.get("/v1/jobs").json()["jobs"]
    assert (job["kind"], job["state"]) == ("tracked-report", "succeeded")
    sent = client.get(job["result"])
    assert sent.headers["content-type"] == "application/zip"
    assert sent.content == (tmp_path / "report.zip").read_bytes()
    with zipfile.ZipFile(io.BytesIO(sent.content)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert list(files) == ["report.pdf", "report.fhir.json", "frames.csv", "view.html"]
    bundle = json.loads(files["report.fhir.json"])
    jsonschema.validate(bundle, PROFILE)
    assert "ventricle-simulated-normal-displacement" in files["report.fhir.json"].decode()
    (track,) = client.get("/v1/sequences?tracked=true").json()["sequences"]
    here = f"/v1/signatures/{track['id']}"
    # The same as step by step.
    model = "?model=ventricle-simulated-normal-displacement"
    assert client.get(f"{here}/report{model}").json() == bundle
    table = client.get(f"{here}/report", headers={"Accept": "text/csv"})
    assert table.content == files["frames.csv"]
    assert client.delete(here.replace("signatures", "sequences")).status_code == 204
    assert client.get(job["result"]).status_code == 404
    assert client.get("/v1/jobs").json()["jobs"] == []


def test_what_is_wrong_is_told_before_a_job(client: TestClient, phantom: bytes) -> None:
    here = "/v1/tracks?report=true"
    assert client.post(f"{here}&model=nobodys", content=phantom).status_code == 404
    assert client.post(f"{here}&images={'0' * 64}").status_code == 404
    assert client.post(f"{here}&start={'0' * 64}", content=phantom).status_code == 404
    wrong = client.post(f"{here}&landmarks=here", content=phantom)
    assert wrong.status_code == 422
    failed = finished(client, client.post(here, content=b"no images").json())
    assert failed["state"] == "failed"
    assert failed["error"]["remedy"]
    # Told to have failed, a job removes its upload.
    folder = client.app.state.owners.local.spool.folder  # type: ignore[attr-defined]
    until = time.monotonic() + 60.0
    while list(folder.iterdir()) and time.monotonic() < until:
        time.sleep(0.01)
    assert list(folder.iterdir()) == []


def test_a_service_that_ends_between_track_and_report_goes_on(
    tmp_path: Path, phantom: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The images are there until the report is, and no longer."""
    settings = small_settings(tmp_path / "results").model_copy(update={"drain_seconds": 0.0})
    begun = threading.Event()

    async def endless(*_: object) -> Path:
        begun.set()
        await asyncio.sleep(3600.0)
        raise AssertionError

    monkeypatch.setattr(recording_operations, "_whole_report", endless)
    with served(settings) as client:
        images = client.post("/v1/images", content=phantom).json()["id"]
        query = {"landmarks": json.dumps(PLACES["landmarks"]), "images": images, "modes": "7"}
        job = client.post("/v1/tracks", params={**query, "report": "true"}).json()
        assert begun.wait(60.0)
        assert client.get(job["links"]["self"]).json()["result"] is None
    monkeypatch.undo()
    with served(settings) as client:
        done = finished(client, job)
        assert (done["state"], done["error"]) == ("succeeded", None)
        assert client.get(done["result"]).content.startswith(b"PK")
        assert client.get(f"/v1/images/{images}").status_code == 404
        assert len(client.get("/v1/sequences?tracked=true").json()["sequences"]) == 1
