"""The container against its text: a decoder made from docs/format.md reads every stream."""

from __future__ import annotations

import numpy as np
import pytest
from codec_from_the_text import decode_from_the_text
from codec_sequences import jointed
from numpy.typing import NDArray

from modalmotion.codec import Effort, decode, encode, encoder
from modalmotion.codec import container as codec_faces
from modalmotion.codec import frames as codec_choice
from modalmotion.codec.spatial_modes import Cut
from modalmotion.codec.temporal import Temporal
from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CYLINDER


def moving(rng: np.random.Generator, n_frames: int, shape: tuple[int, int]) -> NDArray[np.float64]:
    s, theta = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij")
    frames = []
    for t in range(n_frames):
        angle = 2 * np.pi * (theta / shape[1] + 0.02 * t)
        radius = 9.0 + np.sin(0.7 * t) * s
        frames.append([radius * np.cos(angle), radius * np.sin(angle), 5.0 * s])
    vertices = np.array(frames).transpose(0, 2, 3, 1).reshape(n_frames, -1, 3)
    noisy: NDArray[np.float64] = vertices + rng.normal(scale=0.05, size=vertices.shape)
    return noisy


def require_same(sequence: MeshSequence, **asked: object) -> None:
    data = encode(sequence, **asked).data  # type: ignore[arg-type]
    vertices, faces = decode_from_the_text(data)
    decoded = decode(data)
    assert np.array_equal(vertices, decoded.vertices)
    assert np.array_equal(np.array(faces).reshape(-1, 3), decoded.faces)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


@pytest.mark.parametrize(
    "topology", ["plane", "cylinder", "torus", "cup", "sphere", "closed x pole-open x closed"]
)
def test_lattices_of_every_topology(topology: str, rng: np.random.Generator) -> None:
    vertices = moving(rng, 5, (4, 6))
    grid = (2, 2, 6) if topology.count("x") == 2 else (4, 6)
    require_same(mesh_sequence(vertices, grid=grid, topology=topology, unit="cm"), rms=0.1)


def test_curves_and_points(rng: np.random.Generator) -> None:
    vertices = moving(rng, 6, (1, 9)).astype(np.float32)
    require_same(mesh_sequence(vertices, topology="closed curve"), max_error=0.05)
    require_same(mesh_sequence(vertices, times=rng.uniform(size=6).cumsum()), rms=0.05)


@pytest.mark.parametrize("kind", list(Temporal))
def test_every_temporal_basis(
    kind: Temporal, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = mesh_sequence(moving(rng, 7, (4, 6)), grid=(4, 6), topology="cylinder")
    if kind == Temporal.PARTS:
        sequence = jointed(rng)
    chosen = codec_choice.choose(sequence, Effort.FAST)
    only = codec_choice.Choice(chosen.modes, (kind,), chosen.effort, chosen.name)
    monkeypatch.setattr(encoder, "choose", lambda *_: only)
    require_same(sequence, rms=0.05)
    require_same(sequence, max_error=0.02)


@pytest.mark.parametrize(
    "cut", [Cut(4096, 4096), Cut(7, 7), Cut(24, 8, 96), Cut(13, 5, 255), Cut(24, 6, 0)]
)
def test_spring_modes_whole_in_patches_and_joined(
    cut: Cut, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(codec_choice, "CUTS", dict.fromkeys(Effort, cut))
    faces = lattice_faces(CYLINDER, (4, 6))
    shuffled = rng.permutation(26)[:24]
    vertices = np.zeros((5, 26, 3))
    vertices[:, shuffled] = moving(rng, 5, (4, 6))
    require_same(mesh_sequence(vertices, shuffled[faces]), max_error=0.2)


@pytest.mark.every(3)
@pytest.mark.parametrize("seed", range(4))
def test_connectivity_of_any_kind(seed: int) -> None:
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, 90, size=(int(rng.integers(1, 80)), 3))
    vertices = rng.normal(size=(2, 90, 3))
    require_same(mesh_sequence(vertices, faces), rms=0.5)


def test_connectivity_numbered_row_by_row() -> None:
    rng = np.random.default_rng(3)
    faces = lattice_faces(CYLINDER, (12, 16))
    faces = faces.reshape(2, -1, 3).transpose(1, 0, 2).reshape(-1, 3)
    sequence = mesh_sequence(moving(rng, 2, (12, 16)), faces)
    require_same(sequence, rms=2.0)


def test_large_meshes_go_without_relations(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(codec_faces, "LARGEST_RELATED", 20)
    sequence = mesh_sequence(moving(rng, 2, (4, 6)), lattice_faces(CYLINDER, (4, 6)))
    require_same(sequence, rms=1.0)


@pytest.mark.parametrize("effort", list(Effort))
def test_every_effort(effort: Effort, rng: np.random.Generator) -> None:
    sequence = mesh_sequence(moving(rng, 6, (6, 8)), grid=(6, 8), topology="cylinder")
    require_same(sequence, rms=0.05, effort=effort)


@pytest.mark.parametrize("together", [True, False])
def test_cells_of_a_lattice_take_three_bytes(together: bool, rng: np.random.Generator) -> None:
    faces = lattice_faces(CYLINDER, (4, 6))
    if together:
        faces = faces.reshape(2, -1, 3).transpose(1, 0, 2).reshape(-1, 3)
    vertices = moving(rng, 3, (4, 6))
    lattice = mesh_sequence(vertices, faces, grid=(4, 6), topology="cylinder")
    bare = mesh_sequence(vertices, grid=(4, 6), topology="cylinder")
    require_same(lattice, rms=0.1)
    assert encode(lattice, rms=0.1).n_bytes == encode(bare, rms=0.1).n_bytes + 3


def test_large_numbers_take_the_long_way(rng: np.random.Generator) -> None:
    vertices = moving(rng, 3, (4, 6)) * 1e5
    require_same(mesh_sequence(vertices, grid=(4, 6), topology="cylinder"), max_error=1e-3)
