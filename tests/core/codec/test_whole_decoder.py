"""The compiled decoder gives what the Python one gives, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from codec_sequences import KINDS, Make, jointed, lattice_sequence, random_sequence
from project import DATA
from whole_decoder import whole

from modalmotion.codec import Effort, decode, encode
from modalmotion.formats import read_sequence
from modalmotion.mesh.sequence import mesh_sequence

STORED_WHOLE = 38


def require_same(data: bytes, first: int = 0, stop: int | None = None) -> None:
    found, expected = whole(data, first, stop), decode(data)
    assert not isinstance(found, int), found
    wanted = expected.vertices[first:stop]
    assert found.positions.dtype == wanted.dtype
    assert found.positions.tobytes() == wanted.tobytes()
    assert np.array_equal(found.faces, expected.faces)
    if expected.times is not None:
        assert np.array_equal(found.times, expected.times[first:stop])


@pytest.mark.every(4)
@pytest.mark.parametrize("make", KINDS)
@pytest.mark.parametrize("effort", list(Effort))
def test_every_kind_and_effort(make: Make, effort: Effort, rng: np.random.Generator) -> None:
    sequence = make(rng)
    require_same(encode(sequence, rms=0.1, effort=effort).data)
    require_same(encode(sequence, max_error=0.2, effort=effort).data)


def test_surfaces_of_any_kind(rng: np.random.Generator) -> None:
    for _ in range(30):
        sequence = random_sequence(rng)
        extent = float(np.ptp(sequence.vertices))
        effort = Effort(rng.choice([effort.value for effort in Effort]))
        require_same(encode(sequence, rms=10.0 ** rng.uniform(-4, -1) * extent, effort=effort).data)


def test_times_and_parts_of_a_sequence(rng: np.random.Generator) -> None:
    sequence = lattice_sequence(rng)
    require_same(encode(sequence, rms=0.1).data, 2, 5)
    vertices = sequence.vertices.copy()
    times = np.sort(rng.uniform(size=len(vertices)))
    require_same(encode(mesh_sequence(vertices, sequence.faces, times=times), rms=0.1).data, 1)


def test_parts_that_move_as_one(rng: np.random.Generator) -> None:
    encoded = encode(jointed(rng, n_links=7, n_frames=30), rms=0.05)
    assert encoded.n_bytes < 30_000
    require_same(encoded.data)


@pytest.mark.parametrize("kind", ["cup", "sphere", "torus"])
def test_poles_and_turns(kind: str, rng: np.random.Generator) -> None:
    s, theta = np.meshgrid(np.arange(10) / 10, np.arange(12) / 6 * np.pi, indexing="ij")
    ring = np.stack([s * np.cos(theta), s * np.sin(theta), s**2], axis=-1).reshape(-1, 3)
    beat = 1.0 + 0.1 * np.sin(np.linspace(0.0, 6.0, 7))[:, None, None]
    vertices = beat * ring + rng.normal(scale=1e-3, size=ring.shape)
    require_same(encode(mesh_sequence(vertices, grid=(10, 12), topology=kind), rms=1e-3).data)


def test_many_pieces_need_room_in_proportion(rng: np.random.Generator) -> None:
    faces = np.arange(6000).reshape(-1, 3)
    vertices = rng.normal(size=(2, 6000, 3)).cumsum(axis=1)
    require_same(encode(mesh_sequence(vertices, faces), rms=0.1, effort="fast").data)


def test_long_lines_go_by_the_fast_transform(rng: np.random.Generator) -> None:
    walk = rng.normal(size=(601, 4, 3)).cumsum(axis=0)
    require_same(encode(mesh_sequence(walk), rms=0.05).data)


def test_what_is_stored_without_loss_is_refused(rng: np.random.Generator) -> None:
    assert whole(encode(lattice_sequence(rng), rms=1e-9).data) == STORED_WHOLE


def test_damage_is_a_status(rng: np.random.Generator) -> None:
    data = encode(lattice_sequence(rng), rms=0.1).data
    for at in rng.integers(0, len(data), 200).tolist():
        for damaged in (data[:at], data[:at] + bytes([data[at] ^ 0x20]) + data[at + 1 :]):
            assert isinstance(whole(damaged), int), at
    assert isinstance(whole(data + b"\0"), int)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["heart/lv_endocardium", "robot/Dance", "fox/run"])
def test_real_recordings(name: str) -> None:
    path = DATA / f"{name}.npz"
    if not path.exists():
        pytest.skip("the real recordings are absent")
    sequence = read_sequence(path).sequence
    extent = float(np.ptp(sequence.vertices))
    for effort in Effort:
        require_same(encode(sequence, rms=1e-3 * extent, effort=effort).data)
