"""Features of modes as they are: no start angle changes them, and they say what moves first."""

from __future__ import annotations

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.classification.waves import (
    summary,
    summary_columns,
    wave_columns,
    wave_features,
    waves_of,
)

RING = mm.lowest_modes(mm.CLOSED_CURVE, 7)


def rotated(terms: np.ndarray, angle: float) -> np.ndarray:
    moved = terms.copy()
    cosines = np.flatnonzero(~RING.is_sine[1:]) + 1
    for k in cosines.tolist():
        n = int(RING.wavenumbers[k, 0])
        c, s = np.cos(n * angle), np.sin(n * angle)
        moved[:, k], moved[:, k + 1] = (
            c * terms[:, k] + s * terms[:, k + 1],
            c * terms[:, k + 1] - s * terms[:, k],
        )
    return moved


@pytest.mark.parametrize("is_cycle", [True, False])
def test_a_start_angle_and_a_turn_in_space_change_nothing(is_cycle: bool) -> None:
    rng = np.random.default_rng(2)
    terms = rng.normal(size=(2, 7, 3)) + (1j * rng.normal(size=(2, 7, 3)) if is_cycle else 0.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    waves = waves_of(RING, walls=False)
    for read in (wave_features, summary):
        assert read(rotated(terms, 0.8) @ turn, waves) == pytest.approx(read(terms, waves))
    assert wave_features(rotated(terms, 0.8), waves_of(RING, walls=True)) != pytest.approx(
        wave_features(terms, waves_of(RING, walls=True))
    )


@pytest.mark.parametrize("walls", [True, False])
@pytest.mark.parametrize("is_cycle", [True, False])
def test_each_value_has_a_column(is_cycle: bool, walls: bool) -> None:
    rng = np.random.default_rng(3)
    terms = rng.normal(size=(4, 7, 3)) * (1j if is_cycle else 1.0)
    waves = waves_of(RING, walls=walls)
    assert len(wave_features(terms, waves)) == len(wave_columns(waves, 4, 3))
    few = summary_columns(waves, 4, 3, is_cycle=is_cycle)
    assert len(summary(terms, waves)) == len(few)
    still = wave_columns(waves, 1, 3, ahead=False)
    assert len(wave_features(terms[:1].real, waves, ahead=False)) == len(still)
    names = [column.name for column in wave_columns(waves, 4, 3)]
    assert len(set(names)) == len(names)


def test_which_of_two_modes_moves_first_is_read() -> None:
    sheet = mm.lowest_modes(mm.PLANE, 3)
    waves = waves_of(sheet, walls=False)
    names = [column.name for column in wave_columns(waves, 8, 3)]
    place = names.index(f"ahead {waves.names[1]} {waves.names[2]}")
    t = np.linspace(0.0, 1.0, 2001)
    early, late = (np.exp(-(((t - when) / 0.1) ** 2)) for when in (0.35, 0.65))
    design = np.cos(np.pi * np.arange(9) * t[:, None])
    path = np.zeros((2001, 3, 3))
    path[:, 1, 0], path[:, 2, 0] = early, late
    terms = np.linalg.lstsq(design, path.reshape(2001, -1), rcond=None)[0][1:].reshape(8, 3, 3)
    # Twice the area between the paths, as its integral over time says.
    fitted = np.tensordot(design[:, 1:], terms, axes=1)[:, :, 0]
    a, b = fitted[:, 1], fitted[:, 2]
    area = np.trapezoid(a * np.gradient(b, t) - b * np.gradient(a, t), t)
    value = wave_features(terms, waves)[place]
    assert np.sign(value) * value**2 == pytest.approx(area, rel=0.02)
    assert wave_features(terms[:, [0, 2, 1]], waves)[place] == pytest.approx(-value)
