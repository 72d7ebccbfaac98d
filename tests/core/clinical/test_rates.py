"""Rates of a beating cavity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from viewed_surfaces import viewed

from modalmotion.clinical import ClinicalReadouts, clinical_readouts
from modalmotion.clinical.rates import rates_of
from modalmotion.errors import ParameterError


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
    # 30 ml times 2 pi / 0.8 s, less the share that differences over two steps lose.
    true = 30.0 * 2 * np.pi / 0.8 * np.sinc(2.0 / 40)
    assert rates.peak_ejection_rate == pytest.approx(true, rel=1e-6)
    assert rates.peak_filling_rate == pytest.approx(true, rel=1e-6)
    assert (rates.ejection_frame, rates.filling_frame) == (10, 30)
    assert rates.ejection_bound == pytest.approx(2.0 / (2 * 0.02))
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
    # Between the frames on both sides; without a period there is one side only.
    assert closed.filling_bound == pytest.approx(2.0 / (2 * 0.02))
    assert rates_of(shifted).filling_bound == pytest.approx(2.0 / 0.02)
    assert rates_of(shifted).heart_rate is None
    assert rates_of(shifted).cardiac_output is None


def test_without_times_there_are_no_rates() -> None:
    with pytest.raises(ParameterError, match="times"):
        rates_of(replace(beating(), times=None))
