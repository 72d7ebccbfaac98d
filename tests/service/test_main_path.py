"""The main job over HTTP: upload, signature, class."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bent_surfaces import bent_beat
from fastapi.testclient import TestClient
from matplotlib.image import imread
from signing import signed

from modalmotion.formats import read_npz, write_npz
from modalmotion.pictures.signature import signature_figure
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import signature_from_hdf5, signature_image, signature_to_hdf5
from modalmotion_service.work.tasks import signatures
from modalmotion_service.workspace.analysis import Analysis

HDF5 = {"Accept": "application/x-hdf5"}


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def data_dir(shared_data_dir: Path) -> Path:
    return shared_data_dir


def send(client: TestClient, body: bytes, **query: str) -> str:
    answer = client.post("/v1/sequences", content=body, params=query)
    assert answer.status_code in (200, 201), answer.text
    return str(answer.json()["id"])


def test_an_upload_is_answered_with_what_was_understood(
    fresh_client: TestClient, beat: bytes
) -> None:
    answer = fresh_client.post("/v1/sequences", content=beat)
    assert answer.status_code == 201
    summary = answer.json()
    sequence = read_npz(beat).sequence
    assert summary["id"] == sequence.id
    assert answer.headers["location"] == f"/v1/sequences/{sequence.id}"
    assert (summary["n_frames"], summary["n_vertices"]) == sequence.vertices.shape[:2]
    assert summary["grid"] == list(sequence.grid or ())
    assert summary["unit"] == "mm"
    assert (summary["reading"]["format"], summary["reading"]["unit_from"]) == ("npz", "file")
    again = fresh_client.get(answer.headers["location"]).json()
    assert again == {**summary, "reading": None}


def test_the_second_upload_is_known_and_does_nothing_twice(
    client: TestClient, beat: bytes, data_dir: Path
) -> None:
    first = send(client, beat)
    before = {path: path.stat().st_mtime_ns for path in data_dir.rglob("*.h5")}
    again = client.post("/v1/sequences", content=beat)
    assert (again.status_code, again.json()["id"]) == (200, first)
    assert {path: path.stat().st_mtime_ns for path in data_dir.rglob("*.h5")} == before


def test_a_form_and_a_raw_body_are_the_same_upload(client: TestClient, beat: bytes) -> None:
    raw = send(client, beat)
    form = client.post("/v1/sequences", files={"file": ("beat.npz", beat)})
    assert (form.status_code, form.json()["id"]) == (200, raw)


def test_what_the_query_says_goes_over_the_file(
    client: TestClient, npz: Callable[..., bytes]
) -> None:
    body = npz(vertices=np.random.default_rng(3).normal(size=(2, 16, 3)))
    plain = client.post("/v1/sequences", content=body).json()
    stated = client.post(
        "/v1/sequences",
        content=body,
        params={"topology": "cylinder", "grid": "4,4", "unit": "cm", "subject": "s", "label": "l"},
    ).json()
    assert (plain["topology"], plain["grid"], plain["unit"]) == (None, None, None)
    assert (stated["topology"], stated["grid"], stated["unit"]) == ("cylinder", [4, 4], "cm")
    assert (stated["subject"], stated["label"]) == ("s", "l")
    assert stated["id"] != plain["id"]


def test_the_signature_over_http_is_the_librarys_own_bit_for_bit(
    client: TestClient, beat: bytes, data_dir: Path
) -> None:
    own = modal_signature(read_npz(beat).sequence)
    here = signed(client, send(client, beat))
    answer = client.get(here).json()
    assert answer["shape"] == [own.n_frames, 7, 3]
    assert np.array_equal(np.array(answer["amplitudes"]), own.amplitudes)
    assert answer["rms_error"] == own.rms_error
    image = client.get(here, headers=HDF5)
    assert image.headers["content-type"] == "application/x-hdf5"
    assert image.content == signature_to_hdf5(own)
    # Kept files have no facts; the answer has those of the sequence.
    assert (data_dir / answer["file"]).read_bytes() == signature_image(own)
    read = signature_from_hdf5(image.content)
    assert np.array_equal(read.amplitudes, own.amplitudes)
    assert read.modes == own.modes


@pytest.mark.parametrize(
    "media_type", ["application/x-npz", "application/octet-stream", "text/csv"]
)
def test_a_signature_kept_and_one_of_an_upload_come_as_the_same_types(
    media_type: str, client: TestClient, beat: bytes
) -> None:
    accept = {"Accept": media_type}
    sequence_id = send(client, beat)
    kept = client.get(signed(client, sequence_id, modes=4), headers=accept)
    sent = client.post("/v1/signature?modes=4", content=beat, headers=accept)
    assert kept.status_code == sent.status_code == 200
    for answer in (kept, sent):
        assert answer.headers["content-type"].partition(";")[0] == media_type
    assert kept.content == sent.content


def test_a_cohort_is_a_table_with_a_row_for_each(client: TestClient, beat: bytes) -> None:
    sequence_id = send(client, beat)
    body = {"ids": [sequence_id, sequence_id], "modes": 4}
    answer = client.post("/v1/signatures/query", json=body, headers={"Accept": "text/csv"})
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert [row["recording"] for row in rows] == [sequence_id, sequence_id]
    own = client.get(f"{signed(client, sequence_id, modes=4)}/readouts").json()["from_signature"]
    assert float(rows[0]["ejection_fraction_percent"]) == own["ejection_fraction"]["value"]


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0]])
def test_closed_surfaces_of_one_mesh_have_one_kind_of_modes(
    order: list[int], client: TestClient
) -> None:
    rng = np.random.default_rng(3)
    # By their shapes the first two are spheres, the last has the springs of its mesh.
    beats = [write_npz(bent_beat("strong", angle, rng)) for angle in (0.3, 0.6, 3.4)]
    ids = [send(client, beats[number]) for number in order]

    def kinds(ids: list[str]) -> set[str]:
        answer = client.post("/v1/signatures/query", json={"ids": ids, "modes": 4})
        assert answer.status_code == 200, answer.text
        with np.load(io.BytesIO(answer.content)) as arrays:
            return {str(arrays[f"modes_{k}"].tolist()) for k in range(len(ids))}

    alone = {number: kinds([one]) for number, one in zip(order, ids, strict=True)}
    assert alone[0] == alone[1] != alone[2]
    assert kinds(ids) == alone[2]
    straight = [one for number, one in zip(order, ids, strict=True) if number < 2]
    assert kinds(straight) == alone[0]
    # Two compare too.
    answer = client.get(f"/v1/signatures/{straight[0]}/distance?to={ids[order.index(2)]}")
    assert answer.status_code == 200, answer.text


def test_a_file_is_a_stream_of_octets_where_no_other_is(client: TestClient, beat: bytes) -> None:
    octets = {"Accept": "application/octet-stream"}
    sequence_id = send(client, beat)
    for what, media_type in (
        (f"sequences/{sequence_id}/encoded?rms=1", "vnd.modalmotion.stream"),
        (f"signatures/{sequence_id}/reconstruction", "x-npz"),
    ):
        answer = client.get(f"/v1/{what}", headers=octets)
        assert answer.headers["content-type"] == f"application/{media_type}"
    # JSON and text are none.
    assert client.get(f"/v1/sequences/{sequence_id}", headers=octets).status_code == 200
    assert client.get("/v1/models/ventricle-simulated", headers=octets).status_code == 200


@pytest.mark.thorough
def test_a_picture_of_a_signature_is_the_librarys_own(
    client: TestClient, beat: bytes, npz: Callable[..., bytes]
) -> None:
    sequence = read_npz(beat).sequence
    parameters = SignatureParameters(modes=4)
    buffer = io.BytesIO()
    figure = signature_figure(sequence, modal_signature(sequence, parameters))
    figure.savefig(buffer, format="png")
    as_picture = {"Accept": "image/png"}
    here = signed(client, send(client, beat), modes=4)
    kept = client.get(here, headers=as_picture)
    assert kept.headers["content-type"] == "image/png"
    assert np.array_equal(imread(io.BytesIO(kept.content)), imread(io.BytesIO(buffer.getvalue())))
    tag = {"If-None-Match": kept.headers["etag"]}
    assert client.get(here, headers={**as_picture, **tag}).status_code == 304
    assert client.get(here, headers=tag).status_code == 200
    sent = client.post("/v1/signature?modes=4", content=beat, headers=as_picture)
    assert sent.content == kept.content
    # Far from anything that has a shape.
    odd = npz(vertices=1e-300 * np.random.default_rng(3).normal(size=(2, 16, 3)))
    query = "topology=open_curve&grid=16"
    answer = client.post(f"/v1/signature?{query}", content=odd, headers=as_picture)
    assert answer.status_code == 200, answer.text


def test_a_signature_is_made_once_and_then_taken_from_the_store(
    client: TestClient, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence_id = send(client, beat)
    here = signed(client, sequence_id)
    first = client.get(here).content

    work = Analysis.work

    def watched(self: Analysis, task: Any, *args: Any) -> Any:
        assert task is not signatures.sign, "made a second time"
        return work(self, task, *args)

    monkeypatch.setattr(Analysis, "work", watched)
    assert client.get(here).content == first
    assert signed(client, sequence_id, modes=7) == here
    assert client.get(f"/v1/sequences/{sequence_id}/signature").content == first


def test_what_only_reads_keeps_nothing(
    fresh_client: TestClient, beat: bytes, fresh_data_dir: Path
) -> None:
    sequence_id = send(fresh_client, beat)
    before = sorted(fresh_data_dir.rglob("*.*"))
    for link in (
        f"/v1/sequences/{sequence_id}/signature",
        *(f"/v1/signatures/{sequence_id}{path}" for path in ("", "/readouts", "/strain", "/view")),
        f"/v1/signatures/{sequence_id}/distance?to={sequence_id}",
    ):
        assert fresh_client.get(link).status_code == 200, link
    assert sorted(fresh_data_dir.rglob("*.*")) == before


def test_signatures_are_listed_and_deleted(
    fresh_client: TestClient, beat: bytes, fresh_data_dir: Path
) -> None:
    sequence_id = send(fresh_client, beat)
    links = [signed(fresh_client, sequence_id, modes=modes) for modes in (4, 9)]
    list_link = f"/v1/sequences/{sequence_id}/signatures"
    first = fresh_client.get(list_link, params={"limit": 1}).json()
    rest = fresh_client.get(list_link, params={"cursor": first["cursor"]}).json()
    listed = [*first["signatures"], *rest["signatures"]]
    assert sorted(one["links"]["self"] for one in listed) == sorted(links)
    assert {one["n_modes"] for one in listed} == {4, 9}
    assert fresh_client.delete(links[0]).status_code == 204
    assert fresh_client.get(links[0]).status_code == 404
    assert fresh_client.get(f"{links[0]}/readouts").status_code == 404
    assert fresh_client.delete(links[0]).status_code == 404
    assert fresh_client.get(links[1]).status_code == 200
    key = links[0].rpartition("/")[2]
    assert not [path for path in fresh_data_dir.rglob("*") if key in path.name]
    assert signed(fresh_client, sequence_id, modes=4) == links[0]


def test_parameters_change_the_answer_and_are_kept_apart(client: TestClient, beat: bytes) -> None:
    here = f"/v1/sequences/{send(client, beat)}/signatures"
    cup = client.post(here).json()
    cylinder = client.post(here, json={"topology": "cylinder"}).json()
    more = client.post(here, json={"modes": 17}).json()
    assert (cup["topology"], cylinder["topology"]) == ("cup", "cylinder")
    assert more["shape"][1] == 18
    assert more["rms_error"] < cup["rms_error"] < cylinder["rms_error"]
    assert len({cup["file"], cylinder["file"], more["file"]}) == 3


def test_a_classification_has_a_class_a_probability_and_a_file(
    client: TestClient, beat: bytes, data_dir: Path
) -> None:
    here = f"/v1/signatures/{send(client, beat)}/classifications"
    first = client.post(here)
    assert first.status_code == 201
    answer = first.json()
    assert answer["label"] == "normal"
    assert answer["probability"] == max(answer["probabilities"].values())
    assert sum(answer["probabilities"].values()) == pytest.approx(1.0)
    assert (data_dir / answer["file"]).is_file()
    again = client.post(here, json={"model": "ventricle-simulated"})
    assert (again.status_code, again.json()) == (200, answer)


def test_what_the_points_follow_chooses_the_shipped_model(client: TestClient, beat: bytes) -> None:
    sequence_id = send(client, beat)
    here = f"/v1/sequences/{sequence_id}"
    named: list[tuple[str, bool]] = []
    for tracking in ("material", "normal_displacement", "unknown"):
        assert client.patch(here, json={"facts": {"tracking": tracking}}).status_code == 200
        answer = client.post(f"/v1/signatures/{sequence_id}/classifications").json()
        named.append((answer["model"], "tracking=material" in answer["notes"][0]["text"]))
    normal = "ventricle-simulated-normal-displacement"
    assert named == [("ventricle-simulated", False), (normal, False), (normal, True)]
    sent = {
        tracking: client.post("/v1/classify", params={"tracking": tracking}, content=beat).json()
        for tracking in ("material", "normal_displacement")
    }
    assert [sent[one]["model"] for one in sent] == ["ventricle-simulated", normal]
    client.patch(here, json={"facts": {"tracking": "material"}})


def test_the_real_ventricle_over_http(client: TestClient, real_data: Path) -> None:
    grid = send(client, (real_data / "heart/lv_grid_32x64.npz").read_bytes())
    cup, stated, more = (
        client.get(signed(client, grid, **wanted)).json()
        for wanted in ({"topology": "cup"}, {}, {"topology": "cup", "modes": 18})
    )
    assert cup["weighted_rms_error"] <= 1.30
    assert stated["topology"] == "cylinder"
    assert stated["weighted_rms_error"] <= 1.46
    assert more["weighted_rms_error"] <= 0.95
    mesh = send(client, (real_data / "heart/lv_endocardium.npz").read_bytes())
    found = client.get(f"/v1/sequences/{mesh}/signature").json()
    assert (found["topology"], found["shape"]) == ("cup", [25, 7, 3])
    assert found["rms_error"] <= 1.55
    assert client.post(f"/v1/signatures/{mesh}/classifications").status_code == 201


def test_results_outlive_the_service(
    fresh_client: TestClient, beat: bytes, fresh_data_dir: Path
) -> None:
    from modalmotion.store import ResultStore

    sequence_id = send(fresh_client, beat)
    parameters = SignatureParameters()
    signed(fresh_client, sequence_id)
    fresh_client.__exit__()
    with ResultStore(fresh_data_dir) as store:
        kept = store.signature(sequence_id, parameters.key)
        assert np.array_equal(kept.amplitudes, modal_signature(read_npz(beat).sequence).amplitudes)
    fresh_client.__enter__()


@pytest.mark.parametrize("damage", ["flipped", "cut", "gone"])
def test_a_damaged_result_is_made_again(
    client: TestClient, beat: bytes, data_dir: Path, damage: str
) -> None:
    sequence_id = send(client, beat)
    link = signed(client, sequence_id)
    before = client.get(link, headers=HDF5).content
    kept = data_dir / client.get(link).json()["file"]
    whole = kept.read_bytes()
    data = bytearray(whole)
    data[len(data) // 2] ^= 1
    if damage == "gone":
        kept.unlink()
    else:
        kept.write_bytes(data if damage == "flipped" else data[:-1000])
    # What reads says so, and writes nothing.
    answer = client.get(link, headers=HDF5)
    assert (answer.status_code, answer.json()["code"]) == (409, "lost_file")
    assert signed(client, sequence_id) == link
    answer = client.get(link, headers=HDF5)
    assert (answer.status_code, answer.content) == (200, before)
    assert kept.read_bytes() == whole
