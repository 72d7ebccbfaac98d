"""Tracks over HTTP: made, kept, shown, listed, deleted with what derives from them."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from clouds import Floats, as_npz, breathing_spheroid, small_recording
from fastapi.testclient import TestClient
from job_requests import ASYNC, finished
from services import served
from signing import signed

from modalmotion.formats import write_npz
from modalmotion.formats.ply import write_ply
from modalmotion.mesh import Facts
from modalmotion.mesh.sequence import mesh_sequence, sequence_to_hdf5
from modalmotion.store import track_from_hdf5, track_to_hdf5
from modalmotion.tracking import track
from modalmotion.tracking.reading import read_observed
from modalmotion.viewer.container import read_container
from modalmotion_service.http.negotiation import VIEW
from modalmotion_service.settings import Settings

HERE = "/v1/tracks"
TRACKED = "/v1/sequences?tracked=true"
FEW = {"modes": "4"}
HDF5 = {"Accept": "application/x-hdf5"}


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def recording() -> bytes:
    return small_recording()


@pytest.fixture(scope="module")
def link(client: TestClient, recording: bytes) -> str:
    """A track that no test deletes."""
    answer = client.post(HERE, content=recording, params={**FEW, "subject": "P 1", "period": "0.8"})
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def test_a_track_is_made_once_and_is_the_librarys_bit_for_bit(
    client: TestClient, recording: bytes, link: str
) -> None:
    again = client.post(HERE, content=recording, params=FEW)
    assert (again.status_code, again.headers["location"]) == (200, link)
    here = client.get(link).json()
    assert again.json()["residual_rms"] == here["residual_rms"]
    assert link == f"{HERE}/{here['id']}"
    assert here["links"] == {"self": link, "sequence": f"/v1/sequences/{here['id']}"}
    assert here["sequence"]["facts"]["tracking"] == "normal_displacement"
    assert (here["sequence"]["subject"], here["sequence"]["n_frames"]) == ("P 1", 4)
    assert len(here["modes"]) == len(here["determined"]) == 4
    assert here["ejection_fraction"] == pytest.approx(39.5, abs=6.0)
    own = track(read_observed(recording), modes=4, facts=Facts(period=0.8))
    assert client.get(link, headers=HDF5).content == track_to_hdf5(own)


def test_a_track_sent_as_a_sequence_is_one(client: TestClient, recording: bytes) -> None:
    own = track(read_observed(recording), modes=5)
    answer = client.post("/v1/sequences", content=track_to_hdf5(own))
    assert answer.status_code == 201, answer.text
    assert answer.json()["id"] == own.sequence.id
    assert answer.json()["facts"]["tracking"] == "normal_displacement"
    assert any("is a track" in note["text"] for note in answer.json()["reading"]["notes"])


def test_the_tracked_sequence_is_one_like_any_other(client: TestClient, link: str) -> None:
    sequence = client.get(link).json()["links"]["sequence"]
    summary = client.get(sequence).json()
    assert summary["facts"]["tracking"] == "normal_displacement"
    signature = client.post(f"{sequence}/signatures", json={"kind": "normal_displacement"}).json()
    assert np.shape(signature["amplitudes"]) == (4, 7, 1)
    assert np.shape(signature["amplitude_deviations"]) == (4, 7, 1)
    assert 0.0 < signature["deviation_share"] < 1.0
    of = f"/v1/signatures/{signature['key']}"
    distance = client.get(f"{of}/distance", params={"to": signature["key"]}).json()
    assert distance["distance"] == 0.0 < distance["by_errors"]
    # What is corrected there stands in the track too.
    client.patch(sequence, json={"facts": {"modality": "US"}})
    assert client.get(link).json()["sequence"]["facts"]["modality"] == "US"
    kept = track_from_hdf5(client.get(link, headers=HDF5).content)
    assert kept.sequence.facts.modality == "US"


def test_the_page_is_sent_some_of_the_data(client: TestClient, link: str) -> None:
    kept = track_from_hdf5(client.get(link, headers=HDF5).content).data
    assert kept is not None
    answer = client.get(link, headers={"Accept": VIEW})
    header, arrays = read_container(answer.content)
    assert header["counts"] == kept.counts.tolist()
    back = arrays["points"] + np.array(header["origin"])
    assert np.abs(back - kept.points).max() < 1e-4
    # A page of one file holds them itself.
    sequence = client.get(link).json()["links"]["sequence"]
    of = signed(client, sequence, kind="normal_displacement")
    page = client.get(f"{of}/view", headers={"Accept": "text/html"}).text
    (held,) = re.findall(r'data-points="0">([^<]+)<', page)
    assert gzip.decompress(base64.b64decode(held)) == answer.content


@pytest.mark.thorough
def test_a_track_has_pictures_and_a_tag(client: TestClient, link: str) -> None:
    for query in ("", "?frame=0", "?picture=determined", "?picture=data"):
        picture = client.get(link + query, headers={"Accept": "image/png"})
        assert picture.content.startswith(b"\x89PNG"), query
    wrong = client.get(f"{link}?frame=4", headers={"Accept": "image/png"})
    assert (wrong.status_code, wrong.json()["frame"]) == (422, 4)
    known = {"If-None-Match": client.get(link).headers["etag"]}
    assert client.get(link, headers=known).status_code == 304
    assert client.get(link, headers={**known, **HDF5}).status_code == 200
    assert client.get(link, headers={"Accept": "text/csv"}).status_code == 406


def test_tracks_alone_are_listed_by_page_and_filter(client: TestClient, link: str) -> None:
    client.post("/v1/sequences", content=write_npz(breathing_spheroid(2)), params={"label": "x"})
    other = client.post(HERE, content=small_recording(3, seed=5), params={**FEW, "label": "x"})
    ids = [one["id"] for one in client.get(TRACKED).json()["sequences"]]
    assert ids.index(other.json()["id"]) < ids.index(link.rpartition("/")[2])
    (labelled,) = client.get(f"{TRACKED}&label=x").json()["sequences"]
    assert labelled["id"] == other.json()["id"]
    first = client.get(f"{TRACKED}&limit=1").json()
    second = client.get(f"{TRACKED}&limit=1&cursor={first['cursor']}").json()
    assert [first["sequences"][0]["id"], second["sequences"][0]["id"]] == ids[:2]
    client.delete(labelled["links"]["self"])


def test_a_form_states_facts_and_landmarks(client: TestClient) -> None:
    """A cup needs its ends, which any route may state; later ones override earlier ones."""
    beat = breathing_spheroid(2)
    clouds = [x[x[:, 2] < 20.0][::5].astype(np.float64) for x in beat.vertices]
    form = {"landmark:apex": "0,0,-40", "covariate:age": "61", "subject": "P 2"}
    sent = {"file": ("clouds.npz", as_npz(clouds, unit="mm"))}
    without = client.post(HERE, files=sent, params={**FEW, "topology": "cup"})
    assert (without.status_code, without.json()["needed"]) == (422, ["apex", "base"])
    made = client.post(
        HERE, files=sent, data=form, params={**FEW, "landmarks": '{"base": [0, 0, 20]}'}
    )
    assert made.status_code == 201, made.text
    assert made.json()["sequence"]["topology"] == "cup"
    facts = made.json()["sequence"]["facts"]
    assert (facts["covariates"], facts["landmarks"]) == ({"age": 61}, {})
    per_frame = json.dumps({"apex": [[0, 0, -40], None], "base": [0, 0, 20]})
    same = client.post(HERE, files=sent, params={**FEW, "landmarks": per_frame})
    assert (same.status_code, same.json()["id"]) == (200, made.json()["id"])
    in_file = as_npz(clouds, unit="mm", apex=[0.0, 0, -40], base=[0.0, 0, 20])
    assert client.post(HERE, content=in_file, params=FEW).json()["id"] == made.json()["id"]
    other = client.post(HERE, content=in_file, params={**FEW, "subject": "P 3"})
    assert (other.status_code, other.json()["differ"]) == (409, ["subject"])


def test_a_kept_surface_is_started_from(client: TestClient, recording: bytes) -> None:
    beat = breathing_spheroid(1)
    start = client.post("/v1/sequences", content=write_npz(beat)).json()["id"]
    made = client.post(HERE, content=recording, params={**FEW, "start": start})
    assert made.json()["sequence"]["n_vertices"] == beat.n_vertices
    assert made.json()["reference"] == 0
    mean = client.post(HERE, content=recording, params={**FEW, "start": start, "reference": "none"})
    assert mean.json()["reference"] is None
    unknown = client.post(HERE, content=recording, params={"start": "0" * 64})
    assert (unknown.status_code, unknown.json()["code"]) == (404, "not_found")


def test_a_job_ends_with_the_sequence_that_it_starts_from(client: TestClient) -> None:
    start = client.post("/v1/sequences", content=write_npz(breathing_spheroid(3))).json()
    query = {"modes": "60", "start": start["id"]}
    job = client.post(HERE, content=small_recording(40), params=query, headers=ASYNC).json()
    assert client.delete(start["links"]["self"]).status_code == 204
    assert client.get(job["links"]["self"]).status_code == 404


def test_a_job_tracks_and_is_forgotten_with_its_track(client: TestClient) -> None:
    sent, key = small_recording(3, seed=9), {"Idempotency-Key": "track-1"}
    job = client.post(HERE, content=sent, params={**FEW, "subject": "X"}, headers={**ASYNC, **key})
    assert (job.status_code, job.json()["kind"]) == (202, "track")
    replay = client.post(
        HERE, content=sent, params={**FEW, "subject": "X"}, headers={**ASYNC, **key}
    )
    assert replay.headers["idempotency-replayed"] == "true"
    done = finished(client, job.json())
    assert (done["state"], done["progress"]) == ("succeeded", 1.0)
    result = client.get(done["result"])
    assert result.json()["links"]["self"] == done["result"]
    direct = client.post(HERE, content=sent, params=FEW, headers={"Idempotency-Key": "track-2"})
    sequence = result.json()["links"]["sequence"]
    kept = signed(client, sequence)
    assert client.delete(sequence).status_code == 204
    for gone in (done["result"], sequence, kept, job.json()["links"]["self"]):
        assert client.get(gone).status_code == 404
    assert client.delete(sequence).status_code == 404
    assert direct.status_code == 200
    again = client.post(HERE, content=sent, params=FEW, headers={"Idempotency-Key": "track-2"})
    assert again.status_code == 404


def test_a_sequence_that_was_sent_is_no_track(client: TestClient) -> None:
    sent = client.post("/v1/sequences", content=write_npz(breathing_spheroid(2))).json()
    answer = client.get(f"{HERE}/{sent['id']}")
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
    assert client.get(sent["links"]["self"]).status_code == 200


def zipped(**files: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in files.items():
            archive.writestr(name.replace("_dot_", "."), content)
    return buffer.getvalue()


def test_contours_of_the_named_type_are_tracked(client: TestClient) -> None:
    rows, inner = ["x\ty\tz\tcontour type\tslice\tweight\ttime frame"], breathing_spheroid(1)
    for scale, kind in ((1.0, "SAX_LV_ENDOCARDIAL"), (1.25, "SAX_LV_EPICARDIAL")):
        for x, y, z in scale * inner.vertices[0].astype(float):
            rows.append(f"{x}\t{y}\t{z}\t{kind}\t0\t1\t0")
    body = zipped(GPFile_000_dot_txt="\n".join(rows).encode())
    for labels, scale in ((None, 1.0), ("LV_EPICARDIAL", 1.25)):
        asked = {**FEW, "time": "open", **({} if labels is None else {"labels": labels})}
        answer = client.post(HERE, content=body, params=asked)
        assert answer.status_code == 201, answer.text
        own = track_from_hdf5(client.get(answer.headers["location"], headers=HDF5).content)
        size = np.ptp(own.sequence.vertices[0], axis=0) / np.ptp(inner.vertices[0], axis=0)
        assert size == pytest.approx(scale, rel=0.1), labels


POINTS: Floats = np.arange(90.0, dtype=np.float64).reshape(30, 3)
WITH_NAN: Floats = np.where(np.arange(90).reshape(30, 3) == 50, np.nan, POINTS)


@pytest.mark.parametrize(
    ("body", "query", "status", "member", "value"),
    [
        (b"", {}, 400, "code", "malformed_file"),
        (b"what is this", {}, 400, "code", "malformed_file"),
        (as_npz([POINTS, WITH_NAN]), {}, 422, "frame", 1),
        (as_npz([POINTS, WITH_NAN]), {}, 422, "vertex", 16),
        (as_npz([POINTS])[:300], {}, 400, "code", "malformed_file"),
        (as_npz([POINTS], apex="1,2,3"), {}, 422, "code", "wrong_shape"),
        (as_npz([POINTS], vertices=1), {"modes": "401"}, 422, "code", "invalid_request"),
        (as_npz([POINTS[:3]] * 2), {}, 422, "frame", 0),
        (as_npz([POINTS] * 101), {}, 413, "limit", "frames"),
        (as_npz([POINTS] * 2), {"reference": "2"}, 422, "code", "bad_parameter"),
        (as_npz([POINTS] * 2), {"landmarks": "{"}, 422, "code", "invalid_request"),
        (as_npz([POINTS] * 2), {"landmarks": '{"apex": [1, 2]}'}, 422, "landmark", "apex"),
        (as_npz([POINTS] * 2), {"landmarks": '{"nose": [1, 2, 3]}'}, 422, "landmark", "nose"),
        (as_npz([POINTS] * 2), {"tracking": "material"}, 422, "fact", "tracking"),
        (as_npz([POINTS] * 2), {"times": "0,1", "frame_interval": "1"}, 422, "limit", None),
        (zipped(a_dot_md=b"none"), {}, 400, "code", "malformed_file"),
        (zipped(f1_dot_xyz=b"0 0 0\n", f2_dot_xyz=b"0 zero 0\n0 1 1\n1"), {}, 400, "frame", 1),
        (zipped(f1_dot_ply=b"ply\nformat ascii 1.0\nend"), {}, 400, "frame", 0),
    ],
)
def test_what_cannot_be_tracked_is_named(
    client: TestClient,
    body: bytes,
    query: dict[str, str],
    status: int,
    member: str,
    value: object,
) -> None:
    answer = client.post(HERE, content=body, params=query)
    problem = answer.json()
    assert (answer.status_code, problem.get(member)) == (status, value), answer.text
    assert problem["remedy"] or status == 422


def test_a_job_under_way_is_cancelled_and_leaves_nothing(tmp_path: Path) -> None:
    with served(Settings(data_dir=tmp_path, workers=1)) as client:
        sent = small_recording(60)
        job = client.post(HERE, content=sent, params={"modes": "60"}, headers=ASYNC).json()
        here, seen = job["links"]["self"], 0.0
        while seen < 0.15:
            now = client.get(here).json()
            assert now["state"] in ("queued", "running"), now
            seen = now["progress"]
        assert client.delete(here).json()["state"] == "cancelled"
        assert client.get(TRACKED).json()["sequences"] == []
        # The worker is free again, and takes the next one.
        assert client.post(HERE, content=small_recording(2), params=FEW).status_code == 201
        spool = client.app.state.owners.local.spool  # type: ignore[attr-defined]
        assert list(spool.folder.iterdir()) == []


def test_what_has_no_one_mesh_is_sent_here_by_the_door_of_sequences(client: TestClient) -> None:
    ball = breathing_spheroid(2)
    meshes = {
        f"f{k}_dot_ply": write_ply(x, ball.faces[k:], {}) for k, x in enumerate(ball.vertices)
    }
    bodies = {
        "other faces": zipped(**meshes),
        "clouds in files": zipped(f1_dot_xyz=b"0 0 0\n"),
        "clouds in arrays": as_npz([POINTS] * 2),
    }
    for kind, body in bodies.items():
        for path in ("/v1/sequences", "/v1/signature", "/v1/templates"):
            answer = client.post(path, content=body)
            assert answer.status_code in (400, 422), kind
            assert "POST /v1/tracks" in answer.json()["remedy"], (kind, answer.text)
    assert client.post(HERE, content=bodies["other faces"], params=FEW).status_code == 201


def test_a_sequence_of_one_mesh_is_sent_to_the_door_of_sequences(client: TestClient) -> None:
    ball = breathing_spheroid(3)
    moved = mesh_sequence(ball.vertices + 0.01 * np.arange(3)[:, None, None], ball.faces, unit="mm")
    bodies = {"npz": write_npz(moved), "hdf5": sequence_to_hdf5(moved)}
    for kind, body in bodies.items():
        problem = client.post(HERE, content=body).json()
        assert "it is for POST /v1/sequences." in problem["remedy"], (kind, problem)
        assert "modalmotion signature" not in problem["remedy"]
        assert client.post("/v1/sequences", content=body).status_code in (200, 201), kind
    # An archive of anything else is told how to write points too.
    other = io.BytesIO()
    np.savez(other, places=POINTS)
    remedy = client.post(HERE, content=other.getvalue()).json()["remedy"]
    assert "points (frames, n, 3)" in remedy
    assert "POST /v1/sequences" in remedy
