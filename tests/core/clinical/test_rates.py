"""Rates of a beating cavity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from viewed_surfaces import viewed

from modalmotion.clinical import ClinicalReadouts, clinical_readouts
from modalmotion.clinical.readouts import rates_of
from modalmotion.errors import ParameterError

Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def beating(n: int = 40) -> ClinicalReadouts:
    """Readouts whose volume is 100 + 30 cos(2 pi t / 0.8) ml, in mm, with a bound of 1 ml."""
    sequence, signature = viewed("cup")
    made = clinical_readouts(signature, sequence)
    times = 0.8 * np.arange(n) / n
    volumes = 1000.0 * (100.0 + 30.0 * np.cos(2 * np.pi * times / 0.8))
    curve = replace(made.curve, volumes=volumes, bounds=np.full(n, 1000.0), deviations=None)
    return replace(made, curve=curve, times=times)


def test_rates_of_a_cosine_are_its_derivative_s() -> None:
    rates = rates_of(beating(), period=0.8)
    # 30 ml times 2 pi / 0.8 s; chords between neighbours would be 0.4 % low.
    true = 30.0 * 2 * np.pi / 0.8
    assert rates.peak_ejection_rate == pytest.approx(true, rel=1e-5)
    assert rates.peak_filling_rate == pytest.approx(true, rel=1e-5)
    assert (rates.ejection_frame, rates.filling_frame) == (10, 30)
    assert rates.heart_rate == pytest.approx(75.0)
    assert rates.cardiac_output == pytest.approx(60.0 * 75.0)
    assert rates.output_range == pytest.approx((58.0 * 75.0, 62.0 * 75.0))


def test_the_cycle_closes_only_where_a_period_says_so() -> None:
    readouts = beating()
    # The steepest rise is put between the last frame and the first.
    moved = np.roll(readouts.curve.volumes, -30)
    shifted = replace(readouts, curve=replace(readouts.curve, volumes=moved))
    closed = rates_of(shifted, period=0.8)
    assert closed.filling_frame == 0
    assert closed.peak_filling_rate == pytest.approx(30.0 * 2 * np.pi / 0.8, rel=1e-5)
    assert rates_of(shifted).heart_rate is None
    assert rates_of(shifted).cardiac_output is None


@pytest.mark.every(2)
@pytest.mark.parametrize("n", [16, 25, 41])
@pytest.mark.parametrize("how", ["cycle", "repeat", "open"])
def test_the_bound_holds_the_peak_of_the_continuous_curve(n: int, how: str) -> None:
    rng = np.random.default_rng(n)
    inside, off = [], []
    readouts = beating(n)
    for _ in range(60):
        volume, rate = curve_of(rng)
        times = np.arange(n) / (n - 1 if how == "repeat" else n)
        fine = np.linspace(0.0, times[-1] if how == "open" else 1.0, 2001)
        noise = 500.0 * rng.choice([0.0, 0.5]) * rng.standard_normal(n)
        noise[-1] = noise[0] if how == "repeat" else noise[-1]
        sd = np.full(n, 500.0 if noise.any() else 0.0)
        curve = replace(readouts.curve, volumes=1000.0 * volume(times) + noise, bounds=sd)
        shown = replace(readouts, curve=curve, times=times)
        rates = rates_of(shown, None if how == "open" else 1.0)
        for true, found, bound in (
            (-rate(fine).min(), rates.peak_ejection_rate, rates.ejection_bound),
            (rate(fine).max(), rates.peak_filling_rate, rates.filling_bound),
        ):
            inside.append(abs(found - true) <= bound)
            if not noise.any():
                off.append(found / true - 1.0)
    assert np.mean(inside) >= 0.95
    # Chords are off by 20, 9 and 4 %.
    assert np.sqrt(np.mean(np.square(off))) <= {16: 0.08, 25: 0.02, 41: 0.005}[n]


def curve_of(rng: np.random.Generator) -> tuple[Curve, Curve]:
    """A volume in ml over a second, and its rate: one fall and two rises, each a sech squared."""
    centres = rng.uniform([0.15, 0.5, 0.84], [0.22, 0.58, 0.9])
    widths = rng.uniform([0.06, 0.045, 0.035], [0.09, 0.07, 0.055])
    early, stroke = rng.uniform(0.6, 0.85), rng.uniform(40.0, 90.0)
    sizes = 0.5 * stroke * np.array([-1.0, early, 1.0 - early])

    def places(t: NDArray[np.float64]) -> NDArray[np.float64]:
        # Of the beats before and after too.
        from_here: NDArray[np.float64] = np.asarray(t)[..., None, None] - centres
        return np.asarray((from_here - np.array([[-1], [0], [1]])) / widths, dtype=np.float64)

    return (
        lambda t: 120.0 + (sizes * np.tanh(places(t))).sum(axis=(-2, -1)),
        lambda t: (sizes / widths / np.cosh(places(t)) ** 2).sum(axis=(-2, -1)),
    )


def test_without_times_there_are_no_rates() -> None:
    with pytest.raises(ParameterError, match="times"):
        rates_of(replace(beating(), times=None))
