"""Parts about an axis: each is seen alone in the motion that has it alone."""

from __future__ import annotations

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.classification.axis import axis_columns, axis_parts, has_axis

MODES = mm.lowest_modes(mm.CUP, 18)
PLACE = {
    (p, turns, bool(sine)): k
    for k, ((p, turns), sine) in enumerate(
        zip(MODES.wavenumbers.tolist(), MODES.is_sine.tolist(), strict=True)
    )
}


def read(terms: np.ndarray, walls: bool = False) -> dict[str, float]:
    values = axis_parts(terms, MODES, walls=walls)
    columns = axis_columns(MODES, len(terms), is_offset=terms.shape[2] == 1, walls=walls)
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


def test_of_offsets_narrowing_and_one_side_are_read() -> None:
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
