"""Features of motions: parts about an axis, and waves that depend on no origin."""

from __future__ import annotations

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.classification.motion_features import (
    axis_columns,
    axis_parts,
    has_axis,
    summary,
    summary_columns,
    wave_columns,
    wave_features,
    waves_of,
)

MODES = mm.lowest_modes(mm.CUP, 18)
PLACE = {
    (p, turns, bool(sine)): k
    for k, ((p, turns), sine) in enumerate(
        zip(MODES.wavenumbers.tolist(), MODES.is_sine.tolist(), strict=True)
    )
}


def read(terms: np.ndarray, walls: bool = False) -> dict[str, float]:
    values = axis_parts(terms, MODES, walls=walls)
    columns = axis_columns(MODES, len(terms), along_normal=terms.shape[2] == 1, walls=walls)
    assert len(values) == len(columns)
    return {column.name: value for column, value in zip(columns, values.tolist(), strict=True)}


def contracting() -> np.ndarray:
    """Contraction of (0, 1): c = -u e1, s = -u e2."""
    terms = np.zeros((2, 18, 3), dtype=np.complex128)
    terms[0, PLACE[0, 1, False], 0] = terms[0, PLACE[0, 1, True], 1] = -2.0
    return terms


def test_contraction_shortening_and_twist_are_told_apart() -> None:
    terms = contracting()
    terms[0, PLACE[1, 0, False], 2] = 0.5j
    # Turning of (1, 1): c = u e2, s = -u e1.
    terms[1, PLACE[1, 1, False], 1], terms[1, PLACE[1, 1, True], 0] = 0.25, -0.25
    found = read(terms)
    assert found.pop("radial 0 cos 1") == pytest.approx(-2.0)
    assert found.pop("axial 1 sin 1") == pytest.approx(0.5)
    assert found.pop("turning 1 cos 2") == pytest.approx(0.25)
    assert "radial 0 sin 1" not in found
    assert list(found.values()) == pytest.approx([0.0] * len(found))


def test_a_start_angle_and_a_start_phase_change_nothing() -> None:
    rng = np.random.default_rng(1)
    terms = contracting() + 0.3 * (rng.normal(size=(2, 18, 3)) + 1j * rng.normal(size=(2, 18, 3)))
    angle, phase = 0.7, 1.3
    turned = terms * np.exp(1j * phase * np.array([1, 2]))[:, None, None]
    moved = turned.copy()
    # theta' = theta - angle, in a frame of the body that turns with it.
    for (p, turns, sine), k in PLACE.items():
        if turns and not sine:
            j = PLACE[p, turns, True]
            c, s = np.cos(turns * angle), np.sin(turns * angle)
            moved[:, k] = c * turned[:, k] + s * turned[:, j]
            moved[:, j] = c * turned[:, j] - s * turned[:, k]
    c, s = np.cos(angle), np.sin(angle)
    moved = moved @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]).T
    assert read(moved) == pytest.approx(read(terms))


def test_with_walls_a_wall_is_told_from_the_next() -> None:
    terms = contracting()
    terms[0, PLACE[1, 0, False], 0] = 0.4
    other = contracting()
    other[0, PLACE[1, 0, False], 1] = 0.4
    assert read(terms) == pytest.approx(read(other))
    assert read(terms, walls=True) != pytest.approx(read(other, walls=True))


def test_of_normal_displacements_narrowing_and_one_side_are_read() -> None:
    terms = np.zeros((2, 18, 1), dtype=np.complex128)
    terms[0, PLACE[0, 0, False], 0] = -3.0
    terms[0, PLACE[0, 1, False], 0] = terms[0, PLACE[0, 1, True], 0] = 1.0
    found = read(terms)
    assert found.pop("radial 0 cos 1") == pytest.approx(-3.0)
    assert found.pop("side 0 cos 1") == pytest.approx(2.0**0.25)
    assert list(found.values()) == pytest.approx([0.0] * len(found))


def test_only_surfaces_with_an_axis_have_parts() -> None:
    assert has_axis(MODES)
    assert has_axis(mm.lowest_modes(mm.SPHERE, 13))
    for topology in (mm.PLANE, mm.TORUS, mm.OPEN_CURVE, mm.CLOSED_CURVE):
        assert not has_axis(mm.lowest_modes(topology, 7))
    assert not has_axis(mm.lowest_modes(mm.CUP, 1))


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
