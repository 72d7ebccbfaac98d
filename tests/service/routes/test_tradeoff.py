"""The trade over HTTP: by tolerance, as JSON, as a picture, as a job."""

from __future__ import annotations

import time

import numpy as np
import pytest
from fastapi.testclient import TestClient

from modalmotion.formats import write_npz
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, simulate_ventricle

BEAT = simulate_ventricle(
    grid=(8, 16), acquisition=Acquisition(n_frames=8, noise=0.2), rng=np.random.default_rng(3)
)


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def here(client: TestClient) -> str:
    answer = client.post("/v1/sequences", content=write_npz(BEAT))
    return f"/v1/sequences/{answer.json()['id']}"


def test_a_signature_by_tolerance_states_its_price(client: TestClient, here: str) -> None:
    own = modal_signature(BEAT, SignatureParameters(tolerance=1.0))
    answer = client.post(f"{here}/signatures", json={"tolerance": 1.0}).json()
    assert len(answer["modes"]) == len(own.modes)
    assert answer["price"]["rms_error"] == own.rms_error <= 1.0
    assert answer["price"]["bytes"] == own.amplitudes.nbytes
    assert answer["price"]["amplitudes_per_frame"] == 3 * len(own.modes)
    assert answer["choice"]["limit"] == 1.0
    assert own.choice is not None
    assert answer["choice"]["scene"] == own.choice.scene
    assert set(answer["choice"]["errors"]) == {"static", "rigid", "affine"}
    assert answer["parameters"]["tolerance"] == 1.0
    assert answer["parameters"]["modes"] is None


def test_auto_says_what_noise_it_found(client: TestClient, here: str) -> None:
    answer = client.post(f"{here}/signatures", json={"auto": True}).json()
    assert answer["choice"]["noise"]["sigma"] == pytest.approx(0.2, rel=0.2)
    assert any("noise was estimated" in note["text"] for note in answer["notes"])


def test_a_tolerance_out_of_reach_is_a_problem_with_the_best(client: TestClient, here: str) -> None:
    asked = {"tolerance": 0.0}
    answer = client.post(f"{here}/signatures", json=asked)
    assert answer.status_code == 422
    problem = answer.json()
    assert problem["code"] == "tolerance_unreachable"
    assert problem["best_modes"] > 18
    assert problem["best_error_mm"] > 0.0
    assert "remedy" in problem


def test_51_amplitudes_become_whole_pairs(client: TestClient, here: str) -> None:
    whole = client.post(f"{here}/signatures", json={"amplitudes": 51}).json()
    assert whole["shape"] == [8, 18, 3]


@pytest.mark.parametrize(
    "asked",
    [
        {"modes": 7, "tolerance": 1.0},
        {"tolerance": 1.0, "auto": True},
        {"tolerance": "nan"},
        {"tolerance": -1},
        {"tolerance_of": "mean"},
        {"harmonics": 99},
        {"front_modes": 0},
    ],
)
def test_bad_requests_are_refused(
    client: TestClient, here: str, asked: dict[str, str | float]
) -> None:
    assert client.post(f"{here}/tradeoff", json=asked).status_code == 422


def test_mm_without_a_unit_are_refused(client: TestClient) -> None:
    bare = mesh_sequence(BEAT.vertices, grid=BEAT.grid, topology="cup")
    sent = client.post("/v1/sequences", content=write_npz(bare)).json()["id"]
    for route in ("signatures", "tradeoff"):
        answer = client.post(f"/v1/sequences/{sent}/{route}", json={"tolerance": 1.0})
        assert answer.status_code == 422
        assert "Set the unit" in answer.json()["remedy"]


def test_the_front_and_the_chosen_point(client: TestClient, here: str) -> None:
    asked = {"tolerance": 1.0, "front_modes": 25}
    response = client.post(f"{here}/tradeoff", json=asked)
    answer = response.json()
    assert [(b["topology"], b["components"]) for b in answer["front"]] == [
        ("cup", "cartesian"),
        ("cup", "cylindrical"),
        ("cylinder", "cartesian"),
        ("cylinder", "cylindrical"),
    ]
    first = answer["front"][0]
    assert first["modes"][-1] == 25
    seven = modal_signature(BEAT, SignatureParameters(modes=7)).rms_error
    assert first["rms"][first["modes"].index(7)] == pytest.approx(seven, rel=1e-9)
    price = answer["chosen"]["price"]
    assert price["rms_error"] <= 1.0 <= price["max_error"]
    assert {"front", "choice"} <= set(price["milliseconds"])
    assert "worker;dur=" in response.headers["server-timing"]


def test_components_and_topology_can_be_the_only_ones(client: TestClient, here: str) -> None:
    asked: dict[str, str | int] = {
        "only": "cylindrical",
        "topology": "cylinder",
        "front_modes": 7,
    }
    answer = client.post(f"{here}/tradeoff", json=asked).json()
    assert [(b["topology"], b["components"]) for b in answer["front"]] == [
        ("cylinder", "cylindrical")
    ]
    assert answer["chosen"]["components"] == "cylindrical"


@pytest.mark.thorough
def test_a_picture_by_accept(client: TestClient, here: str) -> None:
    few = {"front_modes": 7}
    picture = client.post(f"{here}/tradeoff", json=few, headers={"Accept": "image/png"})
    assert picture.headers["content-type"] == "image/png"
    assert picture.content.startswith(b"\x89PNG")


def test_it_can_be_a_job(client: TestClient, here: str) -> None:
    headers = {"Prefer": "respond-async"}
    accepted = client.post(f"{here}/tradeoff", json={"front_modes": 7}, headers=headers)
    assert accepted.status_code == 202
    job = accepted.headers["location"]
    for _ in range(600):
        if client.get(job).json()["state"] in ("succeeded", "failed"):
            break
        time.sleep(0.05)
    assert client.get(f"{job}/result").json()["chosen"]["modes"] == 7


def test_an_unknown_sequence_is_not_found(client: TestClient) -> None:
    assert client.post(f"/v1/sequences/{'0' * 64}/tradeoff").status_code == 404


def test_a_signature_of_normal_displacements_has_one_amplitude_of_a_mode(
    client: TestClient, here: str
) -> None:
    own = modal_signature(BEAT, SignatureParameters(kind=SignatureKind.NORMAL_DISPLACEMENT))
    answer = client.post(f"{here}/signatures", json={"kind": "normal_displacement"}).json()
    assert answer["kind"] == "normal_displacement" == answer["parameters"]["kind"]
    assert answer["shape"] == [8, 7, 1]
    assert answer["amplitudes"] == own.amplitudes.tolist()
    assert answer["price"]["amplitudes_per_frame"] == 7
    assert client.get(f"{here}/signature").json()["kind"] == "material"


def test_normal_displacements_are_refused_where_only_displacements_serve(
    client: TestClient, here: str
) -> None:
    for call, options in (
        ("signatures", {"auto": True}),
        ("signatures", {"components": "cylindrical"}),
        ("tradeoff", {}),
    ):
        answer = client.post(f"{here}/{call}", json={"kind": "normal_displacement", **options})
        assert answer.status_code == 422
        assert answer.json()["remedy"]
