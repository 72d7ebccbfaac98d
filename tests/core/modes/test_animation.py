"""Animation: reference plus amplitudes times shapes, frame after frame."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from modalmotion.errors import ShapeError
from modalmotion.modes import animate_along, directional_mode
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CYLINDER, lattice_coordinates


def random_basis(n_vertices: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(0)
    return rng.normal(size=(n_vertices, 3)), rng.normal(size=(n_vertices, 7))


X_AXIS = np.array([1.0, 0.0, 0.0])


def test_no_amplitude_leaves_the_reference_as_it_is() -> None:
    X, shapes = random_basis(40)
    (positions,) = animate_along(X, shapes, np.zeros((1, 7)), X_AXIS)
    assert np.array_equal(positions, X)
    assert not np.shares_memory(positions, X)


def test_directional_modes() -> None:
    lattice = Lattice(CYLINDER, (4, 6))
    phi = lattice.shapes(lattice.whole_modes(4))[:, 2]
    for axis in range(3):
        mode = directional_mode(phi, np.eye(3)[axis])
        assert np.array_equal(mode[:, axis], phi)
        assert not mode[:, [i for i in range(3) if i != axis]].any()
    theta = 2 * np.pi * lattice_coordinates(lattice.topology, lattice.shape)[:, 1]
    normals = np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)
    radial = directional_mode(phi, normals)
    assert (radial * normals).sum(axis=1) == pytest.approx(phi)
    assert np.linalg.norm(radial, axis=1) == pytest.approx(np.abs(phi))


def test_moving_along_a_direction_is_moving_by_directional_modes() -> None:
    X, shapes = random_basis(30)
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    amplitudes = rng.normal(size=(4, 7))
    for direction in (np.array([0.0, 0.6, 0.8]), normals):
        modes = [directional_mode(shapes[:, m], direction) for m in range(7)]
        for a, positions in zip(
            amplitudes, animate_along(X, shapes, amplitudes, direction), strict=True
        ):
            expected = X + np.sum([s * mode for s, mode in zip(a, modes, strict=True)], axis=0)
            assert positions == pytest.approx(expected, rel=1e-12, abs=1e-12)


def peak_memory(n_frames: int) -> int:
    X, shapes = random_basis(11_130)

    def amplitudes() -> Iterator[NDArray[np.float64]]:
        rng = np.random.default_rng(4)
        for _ in range(n_frames):
            yield rng.normal(size=7)

    tracemalloc.start()
    try:
        for _ in animate_along(X, shapes, amplitudes(), X_AXIS):
            pass
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_the_number_of_frames() -> None:
    # 11,130 nodes by 21 amplitudes, the size of figure 3's animation.
    few, many = peak_memory(5), peak_memory(200)
    assert many <= few + 20_000
    assert many <= 4 * 11_130 * 3 * 8


def test_same_bits_on_one_thread_and_on_two() -> None:
    X, shapes = random_basis(11_130)
    amplitudes = np.random.default_rng(5).normal(size=(10, 7))
    frames = []
    for n_threads in (1, 2):
        with threadpool_limits(n_threads):
            frames.append(np.array([*animate_along(X, shapes, amplitudes, X_AXIS)]))
    assert np.array_equal(frames[0], frames[1])


def test_what_does_not_fit_is_refused() -> None:
    X, shapes = random_basis(8)
    with pytest.raises(ShapeError):
        animate_along(X[:, :2], shapes, np.zeros((1, 7)), X_AXIS)
    with pytest.raises(ShapeError):
        animate_along(X, shapes[:5], np.zeros((1, 7)), X_AXIS)
    with pytest.raises(ShapeError) as caught:
        list(animate_along(X, shapes, [np.zeros(7), np.zeros(6)], X_AXIS))
    assert caught.value.frame == 1
    with pytest.raises(ShapeError):
        list(animate_along(X, shapes, np.zeros((1, 7)), np.zeros((7, 3))))
    with pytest.raises(ShapeError):
        directional_mode(shapes, np.eye(3)[0])
