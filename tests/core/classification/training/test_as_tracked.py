"""Surfaces as a track leaves them: few modes, noise of clouds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.classification.training.as_tracked import N_MODES, N_POINTS, as_tracked
from modalmotion.classification.training.train_shipped import (
    OFFSET,
    RECORDINGS,
    training_cases,
)
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import (
    Acquisition,
    MotionClass,
    VentricleParameters,
    draw_parameters,
    simulate_ventricle,
)

PARAMETERS: VentricleParameters = draw_parameters(MotionClass.AKINESIA, np.random.default_rng(3))


def beat(n_vertices: int) -> MeshSequence:
    return simulate_ventricle(
        PARAMETERS,
        n_vertices=n_vertices,
        acquisition=Acquisition(n_frames=5),
        rng=np.random.default_rng(4),
    )


def size(vertices: np.ndarray) -> float:
    return float(np.sqrt((vertices**2).sum(axis=-1).mean()))


def test_the_first_frame_stays_and_the_motion_is_cut_down_to_its_modes() -> None:
    sequence = beat(600)
    found = as_tracked(sequence, 0.0, np.random.default_rng(0))
    np.testing.assert_allclose(found.vertices[0], sequence.vertices[0], atol=1e-9)
    left = found.vertices - sequence.vertices
    moved = sequence.vertices - sequence.vertices[0]
    assert 0.001 * size(moved) < size(left) < 0.1 * size(moved)
    # What is cut down already stays as it is, but for the turn that is found.
    again = as_tracked(found, 0.0, np.random.default_rng(0))
    assert size(again.vertices - found.vertices) < 0.05 * size(left)


@pytest.mark.parametrize("n_vertices", [500, 1500])
def test_the_noise_is_that_of_the_clouds_on_any_mesh(n_vertices: int) -> None:
    sequence = beat(n_vertices)
    clean = as_tracked(sequence, 0.0, np.random.default_rng(0)).vertices
    noisy = as_tracked(sequence, 1.0, np.random.default_rng(1)).vertices
    # Three components of each mode, less what the rotation and translation take.
    expected = np.sqrt(3.0 * N_MODES / N_POINTS)
    assert size(noisy[1:] - clean[1:]) == pytest.approx(expected, rel=0.25)
    np.testing.assert_array_equal(
        noisy, as_tracked(sequence, 1.0, np.random.default_rng(1)).vertices
    )


@pytest.mark.thorough
def test_the_model_of_offsets_sees_as_many_ventricles_as_tracks_leave_them() -> None:
    recipe = replace(OFFSET, classes=(MotionClass.NORMAL,))
    subjects = [case.subject or "" for case in training_cases(recipe, 1)]
    tracked = [name for name in subjects if name.startswith("tracked")]
    assert len(tracked) == len(set(tracked)) == len(RECORDINGS)
    assert len(set(subjects)) == 2 * len(RECORDINGS)
    alone = replace(recipe, tracked_seed=None)
    assert [case.subject for case in training_cases(alone, 1)] == subjects[: -len(tracked)]
