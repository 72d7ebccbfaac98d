"""Rotations: never a reflection, exact where they are determined, flagged where they are not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from modalmotion.mesh.alignment import kabsch

RNG = np.random.default_rng(0)


def covariance(points: np.ndarray, moved: np.ndarray) -> np.ndarray:
    centred = points - points.mean(axis=0)
    result: np.ndarray = ((moved - moved.mean(axis=0)).T @ centred)[None]
    return result


def is_rotation(R: np.ndarray) -> bool:
    return bool(np.allclose(R @ R.T, np.eye(3), atol=1e-13) and np.linalg.det(R) > 0.999)


def misfit(R: np.ndarray, points: np.ndarray, moved: np.ndarray) -> float:
    centred = points - points.mean(axis=0)
    return float(np.abs((moved - moved.mean(axis=0)) - centred @ R.T).max())


@given(st.integers(0, 2**32 - 1), st.floats(0, np.pi))
def test_a_rotation_is_found(seed: int, angle: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20, 3)) * [3, 2, 1]
    axis = rng.normal(size=3)
    R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    found = kabsch(covariance(points, points @ R.T))
    assert found.is_determined.all()
    assert found.matrices[0] == pytest.approx(R, abs=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_no_rotation_fits_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, moved = rng.normal(size=(2, 9, 3))
    R = kabsch(covariance(points, moved)).matrices[0]
    assert is_rotation(R)
    C = covariance(points, moved)[0]
    others = Rotation.random(200, random_state=rng).as_matrix()
    nearby = Rotation.from_rotvec(1e-3 * rng.normal(size=(50, 3))).as_matrix() @ R
    best = np.trace(R.T @ C)
    for other in (*others, *nearby):
        assert np.trace(other.T @ C) <= best + 1e-9


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 0, 1], [1, 1, 0], [1, -2, 3]])
def test_rotation_of_exactly_180_degrees(axis: list[float]) -> None:
    unit = np.array(axis) / np.linalg.norm(axis)
    R = 2 * np.outer(unit, unit) - np.eye(3)
    points = RNG.normal(size=(30, 3))
    found = kabsch(covariance(points, points @ R.T))
    assert found.is_determined.all()
    assert found.matrices[0] == pytest.approx(R, abs=1e-13)


def test_mirror_image_is_turned_and_not_mirrored() -> None:
    points = RNG.normal(size=(30, 3)) * [5, 3, 1]
    mirrored = points * [1, 1, -1]
    R = kabsch(covariance(points, mirrored)).matrices[0]
    assert is_rotation(R)
    # Mirrored across the thinnest direction: leaving it as it is fits best.
    assert np.abs(R - np.eye(3)).max() < 0.5


def test_mirror_image_of_a_ball_is_undetermined() -> None:
    points = np.concatenate([np.eye(3), -np.eye(3)])
    found = kabsch(covariance(points, -points))
    assert not found.is_determined.any()
    assert is_rotation(found.matrices[0])


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi])
def test_coplanar_points(angle: float) -> None:
    points = RNG.normal(size=(12, 3)) * [2, 1, 0]
    R = Rotation.from_rotvec([angle, 0.2, -0.1]).as_matrix()
    found = kabsch(covariance(points, points @ R.T))
    assert found.is_determined.all()
    assert found.matrices[0] == pytest.approx(R, abs=1e-12)


def test_collinear_points_turn_as_little_as_they_can() -> None:
    points = np.outer(np.linspace(-1, 1, 9), [1.0, 2.0, -1.0])
    goal = np.array([2.0, 1.0, 1.0])
    moved = np.outer(np.linspace(-1, 1, 9), goal)
    found = kabsch(covariance(points, moved))
    assert not found.is_determined.any()
    R = found.matrices[0]
    assert is_rotation(R)
    assert misfit(R, points, moved) <= 1e-7
    # The smallest turn between two directions is about their common normal.
    one, other = np.array([1, 2, -1]) / 6**0.5, goal / 6**0.5
    smallest = np.arccos(one @ other)
    assert Rotation.from_matrix(R).magnitude() == pytest.approx(smallest, abs=1e-6)


def test_collinear_points_that_stay_are_not_turned() -> None:
    points = np.outer(np.linspace(-1, 1, 9), [1.0, 2.0, -1.0])
    found = kabsch(covariance(points, points))
    assert not found.is_determined.any()
    assert found.matrices[0] == pytest.approx(np.eye(3), abs=1e-7)


@pytest.mark.parametrize("n", [1, 2])
def test_one_or_two_vertices(n: int) -> None:
    points = RNG.normal(size=(n, 3))
    found = kabsch(covariance(points, RNG.normal(size=(n, 3))))
    assert not found.is_determined.any()
    assert is_rotation(found.matrices[0])
    if n == 1:
        assert (found.matrices[0] == np.eye(3)).all()


@pytest.mark.parametrize("scale", [1e-150, 1e-12, 1.0, 1e12, 1e150])
def test_the_unit_does_not_matter(scale: float) -> None:
    points, moved = RNG.normal(size=(2, 15, 3))
    C = covariance(points, moved)
    assert kabsch(C * scale).matrices == pytest.approx(kabsch(C).matrices, abs=1e-13)


def test_thickness_of_rounding_is_no_plane() -> None:
    # Collinear but for what float32 far from the origin makes of it.
    line = np.outer(np.linspace(-1, 1, 40), [1.0, 2.0, -1.0])
    stored = (line + 1e3).astype(np.float32).astype(np.float64)
    C = covariance(stored, stored)
    assert kabsch(C).is_determined.all()
    assert not kabsch(C, tolerance=(4 * 1.2e-7 * 1e3) ** 2).is_determined.any()
