"""A scene that is static, rigid or affine is found to be so."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature import measure_tradeoff
from modalmotion.signature.choice import SceneKind
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import simulate_ventricle

FRAMES = 6


def moving(kind: SceneKind, noise: float = 0.0) -> MeshSequence:
    rng = np.random.default_rng(4)
    beat = simulate_ventricle(grid=(8, 16))
    start = beat.vertices[0].astype(np.float64)
    x = start - start.mean(axis=0)
    frames = []
    for k in range(FRAMES):
        t = np.array([0.5, -0.3, 0.2]) * k
        R = Rotation.from_rotvec([0.0, 0.05 * k, 0.1 * k]).as_matrix()
        A = np.eye(3) + 0.03 * k * np.array([[1.0, 0.2, 0], [0, -0.5, 0.3], [0.1, 0, 0.4]])
        frames.append(
            {
                SceneKind.STATIC: start,
                SceneKind.RIGID: x @ R.T + start.mean(axis=0) + t,
                SceneKind.AFFINE: x @ (R @ A).T + start.mean(axis=0) + t,
                SceneKind.DEFORMABLE: start + k * np.sin(x / 9),
            }[kind]
        )
    vertices = np.stack(frames) + rng.normal(0.0, noise or 1e-300, (FRAMES, *start.shape))
    return mesh_sequence(vertices, beat.faces, grid=beat.grid, topology="cup", unit="mm")


@pytest.mark.every(2)
@pytest.mark.parametrize("kind", [SceneKind.STATIC, SceneKind.RIGID, SceneKind.AFFINE])
@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_the_kind_is_found_and_takes_its_numbers(kind: SceneKind, noise: float) -> None:
    sequence = moving(kind, noise)
    for asked in (
        SignatureParameters(tolerance=1e-6 + 3 * noise),
        SignatureParameters(auto=True),
    ):
        signature = modal_signature(sequence, asked)
        assert signature.choice is not None
        assert signature.choice.scene == kind
        assert any(f"The scene is {kind}" in note for note in signature.notes)


def test_a_static_scene_is_the_smallest_signature_of_zeros() -> None:
    signature = modal_signature(moving(SceneKind.STATIC, 0.2), SignatureParameters(tolerance=0.8))
    assert signature.amplitudes.shape == (FRAMES, 1, 3)
    assert not signature.amplitudes.any()
    assert not signature.translations.any()
    assert (signature.rotations.matrices == np.eye(3)).all()
    assert 0.3 < signature.rms_error <= 0.8


def test_nothing_that_moves_holds_a_tolerance_of_zero() -> None:
    still = modal_signature(moving(SceneKind.STATIC), SignatureParameters(tolerance=0.0))
    assert still.rms_error == still.max_error == 0.0


def test_a_rigid_scene_takes_the_mean_alone() -> None:
    signature = modal_signature(moving(SceneKind.RIGID), SignatureParameters(tolerance=1e-6))
    assert len(signature.modes) == 1
    assert signature.rms_error < 1e-10


def test_a_deforming_scene_is_none_of_them() -> None:
    signature = modal_signature(moving(SceneKind.DEFORMABLE), SignatureParameters(tolerance=0.05))
    assert signature.choice is not None
    assert signature.choice.scene == SceneKind.DEFORMABLE
    errors = signature.choice.errors
    order = [SceneKind.STATIC, SceneKind.RIGID, SceneKind.AFFINE]
    assert [errors[k].rms for k in order] == sorted((errors[k].rms for k in order), reverse=True)


def test_a_flat_reference_has_an_affine_motion_in_its_plane() -> None:
    x, y = np.meshgrid(np.linspace(0, 5, 6), np.linspace(0, 7, 8), indexing="ij")
    start = np.stack([x.ravel(), y.ravel(), np.zeros(48)], axis=1)
    frames = np.stack([start * [1 + 0.1 * k, 1 - 0.05 * k, 1.0] for k in range(4)])
    sequence = mesh_sequence(frames, grid=(6, 8), topology="plane", unit="mm")
    found = measure_tradeoff(sequence, SignatureParameters(tolerance=1e-9))
    assert found.scene[SceneKind.AFFINE].rms < 1e-12
