"""Phases of a cycle by the frames alone, and by the period that is stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.classification.features.temporal import (
    cycle_angle,
    cycle_share,
    elapsed_share,
    harmonics,
)
from modalmotion.facts import Facts
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, simulate_ventricle

PERIOD = 0.8
TERMS = np.array([[1.0 + 0.5j], [0.3 - 0.2j]])


def recorded(covered: float, n: int = 20, period: float | None = PERIOD) -> ModalSignature:
    """A signature whose times cover a share of the period."""
    beat = simulate_ventricle(grid=(8, 12), acquisition=Acquisition(n_frames=n))
    signature = modal_signature(beat, SignatureParameters(modes=7, reference="mean"))
    times = 3.0 + np.linspace(0.0, covered * PERIOD, n)
    return replace(signature, times=times, facts=Facts(period=period))


def signal(times: NDArray[np.float64]) -> NDArray[np.float64]:
    angle = 2 * np.pi * (times - times[0]) / PERIOD
    powers = np.exp(-1j * np.outer(angle, [1, 2]))
    return np.asarray((powers @ TERMS).real + 4.0)


@pytest.mark.parametrize("covered", [0.76, 0.9, 0.95, 1.0])
def test_harmonics_of_a_part_of_the_period_are_those_of_the_whole(covered: float) -> None:
    part = recorded(covered)
    assert part.times is not None
    np.testing.assert_allclose(harmonics(cycle_share(part), signal(part.times), 2), TERMS)
    assert cycle_angle(cycle_share(part))[-1] == pytest.approx(2 * np.pi * covered)


def test_without_a_period_a_recording_is_one_cycle() -> None:
    part = recorded(0.9, period=None)
    assert np.array_equal(cycle_share(part), elapsed_share(part))
    assert part.times is not None
    assert np.abs(harmonics(cycle_share(part), signal(part.times), 2) - TERMS).max() > 0.1


def test_half_a_period_is_not_stretched_over_a_whole_one() -> None:
    part = recorded(0.5)
    assert np.array_equal(cycle_share(part), elapsed_share(part))


def test_a_whole_period_ends_one_step_before_the_first_frame_comes_again() -> None:
    whole = recorded(19 / 20)
    np.testing.assert_allclose(cycle_share(whole), elapsed_share(whole), atol=1e-12)
