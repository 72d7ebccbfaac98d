"""Points out of place are named; surfaces that only move are not accused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import Delaunay

import modalmotion as mm


def disc(depth: float, rng: np.random.Generator, n: int = 300) -> mm.MeshSequence:
    """Paraboloid of radius 20 mm that deepens and widens, on irregular triangles."""
    inner = rng.uniform(-1, 1, (4 * n, 2))
    inner = inner[np.linalg.norm(inner, axis=1) < 0.93][:n]
    angle = 2 * np.pi * np.arange(40) / 40
    plane = np.concatenate([inner, np.stack([np.cos(angle), np.sin(angle)], axis=1)])
    faces = Delaunay(plane).simplices
    phase = np.sin(2 * np.pi * np.arange(8) / 8)
    radius = 20 * (1 - 0.2 * phase)[:, None, None] * plane
    height = depth * (1 + 0.2 * phase)[:, None] * np.square(plane).sum(axis=1)
    vertices = np.concatenate([radius, height[:, :, None]], axis=2)
    return mm.mesh_sequence(vertices, faces=faces, unit="mm")


@pytest.fixture
def beat() -> mm.MeshSequence:
    return disc(60.0, np.random.default_rng(5))


def changed(beat: mm.MeshSequence, vertices: NDArray[np.float64]) -> list[str]:
    sequence = mm.mesh_sequence(vertices, faces=beat.faces, unit=beat.unit)
    return [str(note) for note in mm.modal_signature(sequence).notes if "Frame 3" in note]


def test_an_outlier_is_named_by_frame_and_vertex(beat: mm.MeshSequence) -> None:
    vertices = np.array(beat.vertices, dtype=np.float64)
    vertices[3, 120] += (0.0, 300.0, 0.0)
    (note,) = changed(beat, vertices)
    assert "Frame 3, vertex 120 is out of place" in note
    assert "such vertices" not in note


def test_two_vertices_that_change_numbers_are_found(beat: mm.MeshSequence) -> None:
    vertices = np.array(beat.vertices, dtype=np.float64)
    swapped = [int(vertices[0, :300, 0].argmin()), int(vertices[0, :300, 0].argmax())]
    vertices[3, swapped] = vertices[3, swapped[::-1]]
    (note,) = changed(beat, vertices)
    assert any(f"vertex {vertex} " in note for vertex in swapped)
    assert "2 such vertices" in note


def test_a_frame_numbered_otherwise_is_found(beat: mm.MeshSequence) -> None:
    vertices = np.array(beat.vertices, dtype=np.float64)
    vertices[3] = np.random.default_rng(1).permutation(vertices[3])
    (note,) = changed(beat, vertices)
    assert "numbered otherwise" in note


def test_a_frame_in_another_unit_is_found(beat: mm.MeshSequence) -> None:
    vertices = np.array(beat.vertices, dtype=np.float64)
    vertices[3] /= 10.0
    (note,) = changed(beat, vertices)
    assert "0.1" in note
    assert "another unit" in note


def test_an_outlier_on_a_curve_is_named() -> None:
    along = np.linspace(0.0, 60.0, 40)
    frames = [np.stack([along, np.sin(along / 9 + k), 0 * along], axis=1) for k in range(6)]
    vertices = np.array(frames)
    vertices[4, 11, 1] += 90.0
    sequence = mm.mesh_sequence(vertices, topology="open curve", unit="mm")
    notes = mm.modal_signature(sequence).notes
    assert [note for note in notes if "Frame 4, vertex 11 " in note]


@pytest.mark.every(3)
@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("seed", range(5))
def test_what_only_moves_is_not_accused(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    beat = mm.simulate_ventricle(acquisition=mm.Acquisition(noise=noise), rng=rng)
    still = disc(60.0, rng)
    local = np.array(still.vertices, dtype=np.float64)
    bump = np.exp(-np.square(local[0, :, :2] - (8.0, 0.0)).sum(axis=1) / 30.0)
    local[:] = local[0]
    local[3, :, 2] += 25.0 * bump
    local += rng.normal(0.0, noise / 10, local.shape)
    for sequence in (beat, still, mm.mesh_sequence(local, faces=still.faces, unit="mm")):
        notes = mm.modal_signature(sequence).notes
        assert not [note for note in notes if "out of place" in note or "does not go" in note]


@pytest.mark.parametrize(("depth", "is_shallow"), [(8.0, True), (60.0, False)])
def test_a_sheet_taken_for_a_cup_is_told(depth: float, is_shallow: bool) -> None:
    sheet = disc(depth, np.random.default_rng(2))
    for faces in (sheet.faces, np.concatenate([sheet.faces[:9, ::-1], sheet.faces[9:]])):
        given = mm.mesh_sequence(np.asarray(sheet.vertices), faces=faces, unit="mm")
        found = mm.modal_signature(given)
        assert found.surface == "cup"
        assert any("set topology=plane" in note for note in found.notes) == is_shallow


def test_a_stated_cup_is_believed() -> None:
    sheet = disc(8.0, np.random.default_rng(2))
    asked = mm.SignatureParameters(topology="cup")
    assert not [n for n in mm.modal_signature(sheet, asked).notes if "set topology=plane" in n]
