"""Distances between signatures, and what they are taken over."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.modes import lowest_modes
from modalmotion.modes.topologies import CUP, TORUS
from modalmotion.signature.distance import resample_to_phase, signature_distance, theta_invariants
from modalmotion.template.body_frame import Components

RNG = np.random.default_rng(0)


def test_it_is_the_relative_norm() -> None:
    a, b = RNG.normal(size=(2, 5, 7, 3))
    expected = np.sqrt(((a - b) ** 2).sum() / (b**2).sum())
    assert signature_distance(a, b) == pytest.approx(expected, rel=1e-14)
    assert signature_distance(b, b) == 0.0


@pytest.mark.parametrize("scale", [1e-300, 1e-12, 1e12, 1e300])
def test_the_unit_does_not_matter(scale: float) -> None:
    a, b = RNG.uniform(0.1, 1, size=(2, 5, 7, 3))
    assert signature_distance(a * scale, b * scale) == pytest.approx(
        signature_distance(a, b), rel=1e-12
    )


def test_nothing_against_nothing() -> None:
    still = np.zeros((4, 7, 3))
    assert signature_distance(still, still) == 0.0
    assert signature_distance(still + 1, still) == np.inf


def test_other_shapes_are_refused() -> None:
    with pytest.raises(ShapeError, match="resample"):
        signature_distance(np.zeros((4, 7, 3)), np.zeros((5, 7, 3)))


def slow_interpolation(values: np.ndarray, n: int) -> np.ndarray:
    """Sum of Dirichlet kernels, term by term."""
    m = len(values)
    out = np.zeros((n, *values.shape[1:]))
    for i in range(n):
        for k in range(m):
            x = 2 * np.pi * (i / n - k / m)
            kernel = 1.0 + 2 * sum(np.cos(h * x) for h in range(1, (m - 1) // 2 + 1))
            if m % 2 == 0:
                kernel += np.cos(m // 2 * x)
            out[i] += values[k] * kernel / m
    return out


@given(st.integers(2, 9), st.integers(1, 20))
def test_resampling_is_trigonometric_interpolation(n_frames: int, n_phases: int) -> None:
    values = np.random.default_rng(n_frames).normal(size=(n_frames, 2, 3))
    found = resample_to_phase(values, n_phases)
    assert found == pytest.approx(slow_interpolation(values, n_phases), abs=1e-12)


@given(st.integers(0, 4), st.integers(9, 30))
def test_harmonics_are_resampled_exactly_from_any_times(n_harmonics: int, n_frames: int) -> None:
    rng = np.random.default_rng(n_frames)
    coefficients = rng.normal(size=(n_harmonics + 1, 2, 4, 3))

    def motion(phase: np.ndarray) -> np.ndarray:
        x = 2 * np.pi * np.outer(phase, np.arange(n_harmonics + 1))
        cosines = np.einsum("fh,hmd->fmd", np.cos(x), coefficients[:, 0])
        path: np.ndarray = cosines + np.einsum("fh,hmd->fmd", np.sin(x), coefficients[:, 1])
        return path

    jitter = 0.2 * rng.uniform(-1, 1, n_frames) / n_frames
    times = 0.9 * (np.arange(n_frames) / n_frames + jitter - jitter[0])
    found = resample_to_phase(motion(times / 0.9), 11, times=5 + times, period=0.9)
    assert found == pytest.approx(motion(np.arange(11) / 11), abs=1e-8)


def test_a_movement_keeps_its_ends() -> None:
    values = RNG.normal(size=(8, 3, 3))
    found = resample_to_phase(values, 20, closed=False)
    assert found[[0, -1]] == pytest.approx(values[[0, -1]], abs=1e-13)
    cubic = np.linspace(0, 1, 9)[:, None, None] ** 3 * np.ones((1, 2, 3))
    dense = np.linspace(0, 1, 33)[:, None, None] ** 3
    assert resample_to_phase(cubic, 33, closed=False) == pytest.approx(
        dense * np.ones((1, 2, 3)), abs=1e-13
    )


def test_one_frame_stays() -> None:
    values = RNG.normal(size=(1, 3, 3))
    assert (resample_to_phase(values, 4) == values).all()


def test_a_period_shorter_than_the_frames_is_refused() -> None:
    values = RNG.normal(size=(5, 3, 3))
    with pytest.raises(ParameterError, match="first repetition"):
        resample_to_phase(values, 5, times=np.arange(5).astype(np.float64), period=3.5)
    with pytest.raises(ParameterError, match="at least one"):
        resample_to_phase(values, 0)


@pytest.mark.parametrize("topology", [CUP, TORUS])
def test_invariants_keep_the_energy(topology: object) -> None:
    modes = lowest_modes(topology, 7)  # type: ignore[arg-type]
    a = RNG.normal(size=(4, 7, 3))
    for components in Components:
        found = theta_invariants(a, modes, components)
        assert len(found[0]) == int((~modes.is_sine).sum())
        assert (found**2).sum() == pytest.approx((a**2).sum(), rel=1e-13)
        assert (found >= 0).all()


def test_a_split_pair_has_no_invariants() -> None:
    modes = lowest_modes(CUP, 7).take([0, 1, 3])
    if not modes.is_sine.any():
        modes = lowest_modes(CUP, 7).take(np.flatnonzero(lowest_modes(CUP, 7).is_sine)[:1])
    with pytest.raises(ParameterError, match="without its cosine"):
        theta_invariants(np.zeros((2, len(modes), 3)), modes)
