"""Templates, landmarks, components and reconstructions over HTTP."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from signing import signed

from modalmotion.errors import LimitError
from modalmotion.formats import read_npz, write_npz
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct, resample
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template import make_template
from modalmotion.template.vibration_modes import surface_modes
from modalmotion_service.work.tasks import sequences


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def mesh() -> bytes:
    """A simulated ventricle on triangles."""
    return write_npz(
        simulate_ventricle(
            n_vertices=400, acquisition=Acquisition(n_frames=20), rng=np.random.default_rng(3)
        )
    )


def test_a_template_is_made_once_and_named_by_what_it_was_made_from(
    client: TestClient, mesh: bytes
) -> None:
    sequence = read_npz(mesh).sequence
    unknown = write_npz(replace(sequence, vertices=1.01 * sequence.vertices))
    first = client.post("/v1/templates", content=unknown)
    again = client.post("/v1/templates", content=unknown)
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json() == again.json() == client.get(first.headers["location"]).json()
    answer = first.json()
    assert answer["topology"] == "cup"
    assert set(answer["landmarks"]["strengths"]) >= {"axis", "theta_zero"}
    assert all(0 <= value <= 1 for value in answer["landmarks"]["strengths"].values())
    stated = client.post(
        "/v1/templates", params={"landmarks": '{"theta_zero": 7}'}, content=unknown
    ).json()
    assert stated["id"] != answer["id"]
    assert "theta_zero" in stated["landmarks"]["given"]


@pytest.mark.thorough
def test_a_template_has_a_picture(client: TestClient, mesh: bytes) -> None:
    here = client.post("/v1/templates", content=mesh).headers["location"]
    picture = client.get(here, headers={"Accept": "image/png"})
    assert picture.headers["content-type"] == "image/png"
    assert picture.content.startswith(b"\x89PNG")


def test_a_template_gives_its_vibration_modes(client: TestClient, mesh: bytes) -> None:
    here = client.post("/v1/templates", content=mesh).headers["location"]
    template = make_template(read_npz(mesh).sequence)
    own = surface_modes(template, 3, wave_speed=2.0)
    query = {"modes": 3, "wave_speed": 2.0}
    answer = client.get(f"{here}/modes", params=query).json()
    assert answer["topology"] == "cup"
    assert [(*m["wavenumbers"], m["part"]) for m in answer["modes"]] == [
        (*label.wavenumbers, label.part) for label in own.labels
    ]
    assert answer["angular_frequencies"] == pytest.approx(own.angular_frequencies, abs=1e-15)
    assert answer["shapes"] is None
    assert any("split" in note["text"] for note in answer["notes"])
    whole = client.get(f"{here}/modes", params={**query, "shapes": "true"}).json()
    assert np.array(whole["shapes"]) == pytest.approx(own.shapes)
    npz = client.get(f"{here}/modes", params=query, headers={"Accept": "application/x-npz"})
    with np.load(io.BytesIO(npz.content)) as arrays:
        assert arrays["shapes"] == pytest.approx(own.shapes)
    for accept, start in (("application/x-hdf5", b"\x89HDF"), ("image/png", b"\x89PNG")):
        given = client.get(f"{here}/modes", params=query, headers={"Accept": accept})
        assert given.headers["content-type"] == accept
        assert given.content.startswith(start)
    known = {"If-None-Match": given.headers["etag"], "Accept": accept}
    assert client.get(f"{here}/modes", params=query, headers=known).status_code == 304


def test_modes_that_a_template_does_not_have_are_refused(client: TestClient, mesh: bytes) -> None:
    here = client.post("/v1/templates", content=mesh).headers["location"]
    for query in ("modes=0", "modes=2001", "wave_speed=0", "wave_speed=inf", "mode=3"):
        assert client.get(f"{here}/modes?{query}").status_code == 422, query
    too_many = client.get(f"{here}/modes?modes=1000")
    assert (too_many.status_code, too_many.json()["code"]) == (422, "bad_mode_count")
    assert client.get(f"/v1/templates/{'0' * 64}/modes").status_code == 404
    with pytest.raises(LimitError):
        sequences._require_room(2, 1)


def test_a_cohort_names_one_template(client: TestClient, mesh: bytes) -> None:
    template = client.post("/v1/templates", content=mesh).json()["id"]
    sequence = read_npz(mesh).sequence
    moved = io.BytesIO()
    # Another patient with the same vertices, faces and topology: a little larger.
    np.savez(moved, vertices=sequence.vertices * 1.1, faces=sequence.faces, topology="cup")
    here = client.post("/v1/sequences", content=moved.getvalue()).headers["location"]
    own = client.get(f"{here}/signature").json()
    named = client.get(signed(client, here, template=template)).json()
    assert named["template_id"] == template != own["template_id"]
    assert named["parameters"]["template"] == template
    assert np.allclose(named["amplitudes"], own["amplitudes"], rtol=0.05, atol=0.05)
    unknown = client.post(f"{here}/signatures", json={"template": "0" * 64})
    assert (unknown.status_code, unknown.json()["code"]) == (404, "not_found")


def test_a_template_is_deleted_and_signatures_on_it_stay(client: TestClient, mesh: bytes) -> None:
    here = client.post("/v1/sequences", content=mesh).headers["location"]
    template = client.post(
        "/v1/templates", params={"landmarks": '{"theta_zero": 11}'}, content=mesh
    ).json()["id"]
    assert template in client.get("/v1/templates").json()["templates"]
    link = signed(client, here, template=template)
    before = client.get(link).json()
    assert client.delete(f"/v1/templates/{template}").status_code == 204
    assert template not in client.get("/v1/templates").json()["templates"]
    assert client.get(f"/v1/templates/{template}").status_code == 404
    assert client.delete(f"/v1/templates/{template}").status_code == 404
    assert client.get(link).json() == before
    more = {"template": template, "modes": 4}
    assert client.post(f"{here}/signatures", json=more).status_code == 404
    assert client.get(f"{link}/reconstruction").status_code == 404


def test_a_template_of_another_mesh_is_refused(
    client: TestClient, mesh: bytes, beat: bytes
) -> None:
    template = client.post("/v1/templates", content=mesh).json()["id"]
    here = client.post("/v1/sequences", content=beat).headers["location"]
    answer = client.post(f"{here}/signatures", json={"template": template})
    assert answer.status_code == 422
    assert answer.json()["remedy"]


def test_components_along_the_body_leave_less_of_a_beat_with_one_mode(
    client: TestClient, mesh: bytes
) -> None:
    here = client.post("/v1/sequences", content=mesh).headers["location"]
    plain = client.post(f"{here}/signatures", json={"modes": 1}).json()
    stated = {"modes": 1, "components": "cylindrical"}
    along = client.post(f"{here}/signatures", json=stated).json()
    assert along["components"] == "cylindrical"
    assert along["rms_error"] < 0.9 * plain["rms_error"]


@pytest.mark.parametrize("components", ["cartesian", "cylindrical"])
def test_a_reconstruction_is_what_the_signature_stands_for(
    client: TestClient, mesh: bytes, components: str
) -> None:
    here = client.post("/v1/sequences", content=mesh).headers["location"]
    link = signed(client, here, modes=18, components=components)
    signature = client.get(link).json()
    answer = client.get(f"{link}/reconstruction")
    assert answer.headers["content-type"] == "application/x-npz"
    found = read_npz(answer.content).sequence
    sequence = read_npz(mesh).sequence
    assert found.faces.tolist() == sequence.faces.tolist()
    distance = np.linalg.norm(found.vertices - sequence.vertices, axis=2)
    assert distance.max(axis=1) == pytest.approx(signature["errors"]["max"], abs=1e-9)


def test_a_reconstruction_at_any_time(client: TestClient, mesh: bytes) -> None:
    here = signed(client, client.post("/v1/sequences", content=mesh).json()["id"])
    sequence = read_npz(mesh).sequence
    assert sequence.times is not None
    between = float(sequence.times[2] + sequence.times[3]) / 2
    times = f"{sequence.times[2]!r},{between!r},{sequence.times[3]!r}".replace("np.float64", "")
    times = times.replace("(", "").replace(")", "")
    found = read_npz(client.get(f"{here}/reconstruction?times={times}").content).sequence
    own = reconstruct(modal_signature(sequence, SignatureParameters()), sequence)
    assert found.vertices[0] == pytest.approx(own[2], abs=1e-12)
    assert found.vertices[2] == pytest.approx(own[3], abs=1e-12)
    middle = np.abs(found.vertices[1] - (own[2] + own[3]) / 2).max()
    assert 0 < middle < 0.3 * np.abs(own[3] - own[2]).max()
    late = client.get(f"{here}/reconstruction?times=1e9")
    assert (late.status_code, late.json()["code"]) == (422, "bad_parameter")


def test_a_reconstruction_at_any_phase(client: TestClient, mesh: bytes) -> None:
    here = signed(client, client.post("/v1/sequences", content=mesh).json()["id"])
    sequence = read_npz(mesh).sequence
    own = replace(sequence, vertices=reconstruct(modal_signature(sequence), sequence))
    there = f"{here}/reconstruction"
    for query, phases in (({"phases": "0,0.37"}, [0.0, 0.37]), ({"frames": "60"}, 60)):
        found = read_npz(client.get(there, params=query).content).sequence
        expected = resample(own, phases).sequence
        assert found.vertices == pytest.approx(expected.vertices, abs=1e-9)
        assert found.times == pytest.approx(expected.times)
    for query in ({"phases": "0.5,0.2"}, {"phases": "0.1", "frames": "3"}, {"phases": "1.5"}):
        answer = client.get(there, params=query)
        assert (answer.status_code, answer.json()["code"]) == (422, "bad_parameter")
    glb = client.get(there, params={"frames": 3}, headers={"Accept": "model/gltf-binary"})
    assert glb.status_code == 422


def test_a_surface_without_natural_coordinates_gets_the_modes_of_its_mesh(
    client: TestClient, npz: Callable[..., bytes]
) -> None:
    rng = np.random.default_rng(5)
    # Five tetrahedra, so that there are the modes of every model: no cup and no cylinder.
    one = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    faces = np.concatenate([one + 4 * k for k in range(5)])
    vertices = rng.normal(size=(4, 20, 3))
    body = npz(vertices=vertices, faces=faces, unit="mm")
    here = client.post("/v1/sequences", content=body).headers["location"]
    answer = client.post(f"{here}/signatures", json={"modes": 4}).json()
    assert answer["topology"] == "mesh"
    assert {label["part"] for label in answer["modes"]} == {"spring"}
    assert any("connectivity" in note["text"] for note in answer["notes"])
    again = client.post(
        f"{here}/signatures", json={"modes": 4}, headers={"Accept": "application/x-hdf5"}
    )
    assert again.content.startswith(b"\x89HDF")
    classified = client.post(f"{signed(client, here)}/classifications").json()
    assert classified["label"] is None
    assert classified["notes"]


@pytest.mark.parametrize(
    "stated",
    [
        {"landmarks": {"theta_zero": 99999}},
        {"landmarks": {"apex": "a"}},
        {"landmarks": {"base": [1, 2]}},
        {"components": "round"},
        {"landmarks": {"apex": ["1e999", 0, 0]}},
    ],
)
def test_landmarks_that_are_no_place_are_refused(
    client: TestClient, mesh: bytes, stated: dict[str, Any]
) -> None:
    here = client.post("/v1/sequences", content=mesh).headers["location"]
    answer = client.post(f"{here}/signatures", json=stated)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


def test_two_sequences_are_compared(client: TestClient, mesh: bytes) -> None:
    sequence = read_npz(mesh).sequence
    assert sequence.times is not None
    moved = io.BytesIO()
    np.savez(
        moved,
        vertices=sequence.vertices[:, :, [1, 2, 0]] + 100.0,
        faces=sequence.faces,
        topology="cup",
        times=sequence.times,
        unit="mm",
    )
    one = client.post("/v1/sequences", content=mesh).json()["id"]
    other = client.post("/v1/sequences", content=moved.getvalue()).json()["id"]
    answer = client.get(f"/v1/signatures/{one}/distance", params={"to": other})
    assert answer.status_code == 200, answer.text
    assert answer.json()["distance"] < 1e-9
    unknown = client.get(f"/v1/signatures/{one}/distance", params={"to": "0" * 64})
    assert unknown.status_code == 404


def test_frames_out_of_order_are_sorted_and_it_is_said(
    client: TestClient, npz: Callable[..., bytes]
) -> None:
    vertices = np.random.default_rng(5).normal(size=(3, 16, 3))
    sent = npz(vertices=vertices[[2, 0, 1]], times=[0.2, 0.0, 0.1], grid=[4, 4], topology="cup")
    answer = client.post("/v1/sequences", content=sent).json()
    assert any("out of order" in note["text"] for note in answer["reading"]["notes"])
    ordered = npz(vertices=vertices, times=[0.0, 0.1, 0.2], grid=[4, 4], topology="cup")
    assert client.post("/v1/sequences", content=ordered).json()["id"] == answer["id"]


def test_an_upload_that_options_refuse_is_not_left_behind(client: TestClient, mesh: bytes) -> None:
    both = {"times": "0,0.1", "frame_interval": "0.1"}
    answer = client.post("/v1/templates", content=mesh, params=both)
    assert answer.status_code == 422
    spool = client.app.state.owners.local.spool  # type: ignore[attr-defined]
    assert list(spool.folder.iterdir()) == []
