"""Noise and truncation told apart, and strays left out."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.tracking.noise import Noise, Residuals, noise_of, robust_weights


def residuals(
    sd: float, smooth: float, energy: float, rng: np.random.Generator, n: int = 3000
) -> Residuals:
    """On a plane: white noise, and waves of a few lengths."""
    x = rng.uniform(0, 1, (n, 2))
    waves = sum(
        np.cos(2 * np.pi * (p * x[:, 0] + q * x[:, 1]) + rng.uniform(0, 7))
        for p, q in rng.integers(2, 6, (40, 2))
    ) / np.sqrt(20.0)
    height = sd * rng.normal(size=n) + smooth * np.sqrt(energy) * waves
    points = np.column_stack([x, height])
    return Residuals(points, points * [0, 0, 1], np.ones(n), 0.0, energy)


@pytest.mark.parametrize(("sd", "smooth"), [(1.0, 0.5), (0.3, 0.5), (1.0, 0.0)])
def test_noise_and_truncation_are_told_apart(
    sd: float, smooth: float, rng: np.random.Generator
) -> None:
    frames = [residuals(sd, smooth, energy, rng) for energy in (0.1, 0.5, 1.0, 2.0)]
    found, truncations = noise_of(frames, 50.0, 2, is_exact=False)
    # What the modes leave grows with the motion.
    assert truncations[0] < 0.6 * truncations[3] + 0.01
    assert found.sd == pytest.approx(sd, rel=0.05)
    assert found.truncation == pytest.approx(smooth, rel=0.25, abs=0.15)


def test_what_is_left_at_rest_is_the_error_of_the_shape(rng: np.random.Generator) -> None:
    energies = (0.0, 0.5, 1.0, 2.0)
    frames = [residuals(0.3, 0.5, 1.0, rng)._replace(energy=e) for e in energies]
    _, truncations = noise_of(frames, 50.0, 2, is_exact=False)
    assert truncations == pytest.approx(0.5, rel=0.25)
    # Of a shape that is exact nothing is left where nothing moves.
    assert noise_of(frames, 50.0, 2, is_exact=True)[1][0] == 0.0


def test_amplitudes_that_the_fit_spent_are_counted(rng: np.random.Generator) -> None:
    frame = residuals(1.0, 0.0, 1.0, rng)
    # A fit of as many amplitudes as half the points leaves half the variance.
    spent = frame._replace(residuals=frame.residuals * 0.5**0.5, n_spent=1500.0)
    found, _ = noise_of([spent], 50.0, 2, is_exact=True)
    assert found.total == pytest.approx(1.0, rel=0.06)


def test_a_mean_of_many_points_is_no_better_than_the_truncation() -> None:
    noise = Noise(sd=1.0, truncation=0.5, n_values=50.0)
    for n in (10, 1000, 100_000):
        mean = float(noise.variances(None, n)) / n
        assert mean == pytest.approx(1.0 / n + 0.25 / min(n, 50.0))


def test_strays_have_no_weight_and_expected_sizes_have(rng: np.random.Generator) -> None:
    r = rng.normal(size=1000)
    r[:300] = rng.uniform(20, 60, 300)
    weights = robust_weights(r, 1.0)
    assert weights[:300].max() == 0.0
    assert weights[300:].mean() > 0.8
    # However small all others are, what is expected is no stray.
    assert robust_weights(np.array([1e-9] * 10 + [1.0]), 1.0)[-1] > 0.9


def test_two_points_and_none_are_enough() -> None:
    empty = Residuals(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0.0, 0.0)
    assert noise_of([empty], 10.0, 2, is_exact=True)[0].truncation == 0.0
