"""Images over HTTP: taken in, described, tracked, kept or forgotten, deleted with every mention."""

from __future__ import annotations

import io
import json
import zipfile
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from dicom_samples import slice_file
from ellipsoid_images import LANDMARKS, MIDDLE, Floats, labels, volume
from fastapi.testclient import TestClient
from job_requests import ASYNC, finished
from services import served, small_settings

from modalmotion.formats import ParserHere
from modalmotion.formats.volumes import read_images, reading
from modalmotion.formats.volumes.one_file import write_nifti
from modalmotion.images import ImageSequence
from modalmotion.images.hdf5 import read_images_file
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.viewer.container import read_container, slices_payload
from modalmotion_service.http.negotiation import VIEW
from modalmotion_service.workspace.operation import State
from modalmotion_service.workspace.recording_operations import sweep_images

pytest.importorskip("nibabel")

HERE = "/v1/images"
TRACKS = "/v1/tracks"
PNG = {"Accept": "image/png"}
SHAPE = (27, 27, 35)
COARSE = np.column_stack([3.0 * np.eye(3), MIDDLE - 1.5 * (np.array(SHAPE) - 1)])
FEW = {"modes": "4", "landmarks": json.dumps({k: list(v) for k, v in LANDMARKS.items()})}


def beat(radius: float = 18.0, times: Floats | None = None) -> ImageSequence:
    frames = [volume(r, affine=COARSE, shape=SHAPE) for r in (22.0, radius)]
    return ImageSequence(tuple(frames), np.array([0.0, 0.4]) if times is None else times)


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def file() -> bytes:
    return write_nifti(beat())


def read(file: bytes) -> ImageSequence:
    return read_images(file, parser=ParserHere(DEFAULT_LIMITS))


def state_of(client: TestClient) -> State:
    state: State = client.app.state.owners.local  # type: ignore[attr-defined]
    return state


def sent(client: TestClient, data: bytes) -> str:
    answer = client.post(HERE, content=data)
    assert answer.status_code in (200, 201), answer.text
    return str(answer.json()["id"])


def files_about(client: TestClient, images_id: str) -> list[Path]:
    return [path for path in state_of(client).store.root.rglob(f"{images_id}*") if path.is_file()]


def test_images_are_taken_in_once_and_described_without_a_name(
    client: TestClient, file: bytes
) -> None:
    answer = client.post(HERE, content=file)
    assert answer.status_code == 201, answer.text
    here = answer.json()
    link = answer.headers["location"]
    assert link == f"{HERE}/{here['id']}"
    assert here["id"] == read(file).id
    assert (here["kind"], here["n_frames"], here["shapes"]) == ("volumes", 2, [[27, 27, 35]])
    assert here["spacings"] == [[3.0, 3.0, 3.0]]
    assert here["times"] == [0.0, pytest.approx(0.4)]
    again = client.post(HERE, files={"file": ("name.nii.gz", io.BytesIO(file))})
    assert (again.status_code, again.json()) == (200, here)
    got = client.get(link)
    assert got.json() == here
    assert client.get(link, headers={"If-None-Match": got.headers["etag"]}).status_code == 304
    assert here in client.get(HERE).json()["images"]
    # Nothing of the upload is left but what was read of it.
    assert list(state_of(client).spool.folder.iterdir()) == []
    kept = read_images_file(state_of(client).store.images_path(here["id"]))
    assert np.array_equal(kept.frames[0].values, beat().frames[0].values)  # type: ignore[union-attr]
    assert client.delete(link).status_code == 204


def test_slices_are_given_a_frame_at_a_time_for_the_page(client: TestClient, file: bytes) -> None:
    images = sent(client, file)
    answer = client.get(f"{HERE}/{images}?frame=1")
    assert (answer.status_code, answer.headers["content-type"]) == (200, VIEW)
    assert answer.content == slices_payload(read(file), 1)
    header, _ = read_container(answer.content)
    assert header["parts"][0]["shape"] == list(SHAPE)
    late = client.get(f"{HERE}/{images}?frame=2")
    assert (late.status_code, late.json()["remedy"]) == (
        422,
        "Ask for one of 2 frames, from 0 to 1.",
    )
    assert client.get(f"{HERE}/{images}?frame=-1").status_code == 422
    job = finished(client, client.get(f"{HERE}/{images}?frame=0", headers=ASYNC).json())
    assert client.get(job["result"]).content == slices_payload(read(file), 0)
    assert client.delete(f"{HERE}/{images}").status_code == 204
    assert client.get(f"{HERE}/{images}?frame=0").status_code == 404
    # Nor does the job tell of them, or keep what it made.
    assert list(state_of(client).spool.folder.iterdir()) == []
    assert client.get(job["links"]["self"]).status_code == 404


def test_names_in_headers_reach_no_file(client: TestClient) -> None:
    pytest.importorskip("pydicom")
    rng, packed = np.random.default_rng(0), io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for k in range(4):
            pixels = rng.integers(0, 99, (6, 5))
            data = slice_file(
                pixels, z=4.0 * (k // 2), trigger=400.0 * (k % 2), number=k, patient="Doe^Jane"
            )
            archive.writestr(f"Doe^Jane/{k}.dcm", data)
    here = client.post(HERE, content=packed.getvalue()).json()
    assert (here["kind"], here["n_frames"], here["thicknesses"]) == ("planes", 2, [6.0, 6.0])
    for path in state_of(client).store.root.rglob("*"):
        assert not (path.is_file() and b"Doe" in path.read_bytes()), path
    assert "Doe" not in client.get(HERE).text
    assert client.delete(here["links"]["self"]).status_code == 204


def test_images_go_when_they_were_tracked(client: TestClient, file: bytes) -> None:
    key = {"Idempotency-Key": "images that go"}
    images = client.post(HERE, content=file, headers=key).json()["id"]
    # What cannot be tracked takes nothing away.
    refused = client.post(TRACKS, params={"images": images, "modes": 4})
    assert refused.status_code == 422
    assert "apex and base" in refused.json()["detail"]
    assert files_about(client, images)
    answer = client.post(TRACKS, params={**FEW, "images": images, "papillary": "wall"})
    assert answer.status_code == 201, answer.text
    here = answer.json()
    assert here["images"]["papillary"] == "wall"
    fractions = here["images"]["ejection_fractions"]
    assert here["ejection_fraction"] == pytest.approx(fractions["wall"])
    assert here["sequence"]["facts"]["coordinates"] == "LPS"
    texts = [note["text"] for note in here["notes"]]
    assert len(texts) == len(set(texts))
    assert files_about(client, images) == []
    assert client.get(f"{HERE}/{images}").status_code == 404
    assert client.post(TRACKS, params={**FEW, "images": images}).status_code == 404
    # Nor does the request that brought them, when it is sent again.
    assert client.post(HERE, content=file, headers=key).status_code == 404
    overlay = client.get(answer.headers["location"], params={"picture": "overlay"}, headers=PNG)
    assert overlay.status_code == 404
    assert "keep=true" in overlay.json()["remedy"]
    assert client.delete(here["links"]["sequence"]).status_code == 204


def test_images_that_are_kept_are_drawn_under_the_track(client: TestClient) -> None:
    images = sent(client, write_nifti(beat(17.5)))
    answer = client.post(TRACKS, params={**FEW, "images": images, "keep": "true"})
    assert answer.status_code == 201, answer.text
    link, track = answer.headers["location"], answer.json()["id"]
    here = client.get(f"{HERE}/{images}").json()
    assert (here["is_kept"], here["tracks"]) == (True, [track])
    picture = client.get(link, params={"picture": "overlay"}, headers=PNG)
    assert picture.content.startswith(b"\x89PNG")
    # The page cuts the surface with the slices.
    known = client.get(link)
    assert known.json()["links"]["images"] == f"{HERE}/{images}"
    cut = client.get(f"{HERE}/{images}?frame=1&track={track}")
    assert "vertices" in read_container(cut.content)[1]
    none = client.get(f"{HERE}/{images}?frame=1&track={'0' * 64}")
    assert none.status_code == 404
    # Kept once, they stay, whatever the next request says.
    assert client.post(TRACKS, params={**FEW, "images": images}).status_code == 200
    assert sweep_images(state_of(client), timedelta(0)) == ()
    assert client.delete(known.json()["links"]["sequence"]).status_code == 204
    assert client.get(f"{HERE}/{images}").json()["tracks"] == []
    assert client.delete(f"{HERE}/{images}").status_code == 204
    again = client.get(link, params={"picture": "overlay"}, headers=PNG)
    assert again.status_code == 404


def test_a_track_names_its_images_as_long_as_they_are_there(client: TestClient) -> None:
    images = sent(client, write_nifti(beat(17.2)))
    made = client.post(TRACKS, params={**FEW, "images": images, "keep": "true"})
    link, tag = made.headers["location"], client.get(made.headers["location"]).headers["etag"]
    assert made.json()["links"]["images"] == f"{HERE}/{images}"
    assert client.get(link, headers={"If-None-Match": tag}).status_code == 304
    assert client.delete(f"{HERE}/{images}").status_code == 204
    again = client.get(link, headers={"If-None-Match": tag})
    assert (again.status_code, "images" in again.json()["links"]) == (200, False)
    assert client.delete(again.json()["links"]["sequence"]).status_code == 204


def test_a_job_takes_images_in_and_another_tracks_them(client: TestClient) -> None:
    data = write_nifti(beat(17.0))
    answer = client.post(HERE, content=data, headers=ASYNC)
    assert answer.status_code == 202
    job = finished(client, answer.json())
    assert job["state"] == "succeeded", job
    images = job["result"].rpartition("/")[2]
    asked = client.post(TRACKS, params={**FEW, "images": images, "subject": "P 9"}, headers=ASYNC)
    job = finished(client, asked.json())
    assert job["state"] == "succeeded", job
    assert client.get(job["result"]).json()["sequence"]["subject"] == "P 9"
    # No job says any more what images there were.
    known = state_of(client).jobs.list(limit=1000)[0]
    assert not any(images in str((one.request, one.result)) for one in known)
    assert files_about(client, images) == []
    assert list(state_of(client).spool.folder.iterdir()) == []


def test_labels_are_tracked_without_a_landmark(client: TestClient) -> None:
    images = sent(client, write_nifti(ImageSequence((labels(), labels(18.0)))))
    asked = {"images": images, "modes": "4", "labels": "3"}
    answer = client.post(TRACKS, params=asked)
    assert answer.status_code == 201, answer.text
    assert any("Apex and base were proposed" in note["text"] for note in answer.json()["notes"])


def test_a_label_that_is_no_number_is_refused_before_images_are_read(
    client: TestClient, file: bytes
) -> None:
    named = {**FEW, "labels": "three"}
    asked = {"images": sent(client, file), **named}
    # What is cut short has another fault, which is found only where it is read.
    for answer in (
        client.post(TRACKS, params=asked),
        client.post(TRACKS, content=file[:200], params=named),
    ):
        assert answer.status_code == 422, answer.text
        assert answer.json()["detail"].startswith("The label 'three' is not a whole number")


def test_images_that_nobody_tracks_are_forgotten(client: TestClient) -> None:
    images = sent(client, write_nifti(beat(16.5)))
    assert images not in sweep_images(state_of(client), timedelta(hours=1))
    assert images in sweep_images(state_of(client), timedelta(0))
    assert files_about(client, images) == []


def test_images_in_the_body_of_a_track_are_not_stored(client: TestClient, file: bytes) -> None:
    answer = client.post(TRACKS, content=file, params=FEW)
    assert answer.status_code in (200, 201), answer.text
    assert client.get(f"{HERE}/{read(file).id}").status_code == 404


@pytest.mark.parametrize(
    ("query", "body", "told"),
    [
        ({"images": "0" * 64}, b"", "no images"),
        ({"keep": "true"}, b"x", "none are named"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    client: TestClient, query: dict[str, str], body: bytes, told: str
) -> None:
    answer = client.post(TRACKS, params=query, content=body)
    assert answer.status_code == (404 if "images" in query else 422)
    assert told in answer.text
    assert list(state_of(client).spool.folder.iterdir()) == []


def test_what_is_no_image_is_refused(client: TestClient, file: bytes) -> None:
    for body, status in ((b"", 400), (b"solid x", 400), (file[:200], 400)):
        answer = client.post(HERE, content=body)
        assert answer.status_code == status, answer.text
        assert answer.json()["remedy"]
    form = client.post(HERE, files={"file": ("a", io.BytesIO(file))}, data={"subject": "P 1"})
    assert form.status_code == 422
    beside = client.post(TRACKS, params={"images": sent(client, file)}, content=b"more")
    assert beside.status_code == 422
    assert "Leave the body empty" in beside.json()["remedy"]
    assert list(state_of(client).spool.folder.iterdir()) == []


def test_images_have_limits_of_their_own(tmp_path: Path, file: bytes) -> None:
    settings = small_settings(tmp_path / "r").model_copy(
        update={"max_image_bytes": 200_000, "max_image_body_bytes": len(file)}
    )
    with served(settings) as client:
        limits = client.get("/v1/limits").json()
        assert (limits["image_bytes"], limits["image_body_bytes"]) == (200_000, len(file))
        long = client.post(HERE, content=file + b"0")
        assert (long.status_code, long.json()["limit"]) == (413, "image_body_bytes")
        large = client.post(HERE, content=file)
        assert (large.status_code, large.json()["limit"]) == (413, "image_bytes")
        assert client.get(HERE).json() == {"images": [], "cursor": None}


def test_a_missing_package_is_named_with_the_way_to_install_it(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The parser's package is looked for by whoever asks, so it can be missing here alone."""
    monkeypatch.setattr(reading, "find_spec", lambda _name: None)
    upload = state_of(client).spool.new_path()
    upload.write_bytes(write_nifti(beat()))
    monkeypatch.setattr(state_of(client).analysis, "engine", HereEngine())
    answer = client.post(HERE, content=upload.read_bytes())
    upload.unlink()
    assert answer.status_code == 501, answer.text
    assert "pip install nibabel" in answer.json()["remedy"]


class HereEngine:
    """Does work in this process."""

    def run(self, _terms: object, task: object, *args: object) -> object:
        from concurrent.futures import Future

        future: Future[object] = Future()
        try:
            future.set_result(task(*args))  # type: ignore[operator]
        except Exception as error:  # noqa: BLE001 (as a worker answers it)
            future.set_exception(error)
        return future
