"""Dispersion: frequencies and velocities of waves, by law, by label and by difference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.errors import NonFiniteError, ParameterError, ShapeError
from modalmotion.modes import (
    ModeLabel,
    ModeSet,
    dispersion,
    group_velocity,
    phase_velocity,
    wave_vectors,
)
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import (
    CLOSED,
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    Topology,
)

VOLUME = Topology((OPEN, CLOSED, CLOSED))
LATTICES: list[tuple[Lattice, float | tuple[float, ...]]] = [
    (Lattice(OPEN_CURVE, (7,), 2.0, 0.5), 0.3),
    (Lattice(CLOSED_CURVE, (8,), 2.0, 0.5), 0.3),
    (Lattice(PLANE, (3, 5), (2.0, 0.7)), (0.3, 1.7)),
    (Lattice(CYLINDER, (4, 6), (2.0, 0.7), 3.0), (0.3, 1.7)),
    (Lattice(TORUS, (5, 6), (2.0, 0.7), 3.0), 1.0),
    (Lattice(CUP, (4, 6), (2.0, 0.7)), (0.3, 1.7)),
    (Lattice(SPHERE, (4, 6), (2.0, 0.7)), (0.3, 1.7)),
    (Lattice(VOLUME, (2, 3, 4), (2.0, 0.7, 5.0)), (0.3, 1.7, 0.9)),
]

angle = st.floats(-np.pi, np.pi)


@pytest.mark.parametrize(("lattice", "spacing"), LATTICES)
def test_frequencies_of_wave_vectors_are_those_of_the_labels(
    lattice: Lattice, spacing: float | tuple[float, ...]
) -> None:
    modes = lattice.all_modes()
    k = wave_vectors(lattice, modes, spacing)
    w = lattice.angular_frequencies(modes)
    assert dispersion(lattice, k, spacing) == pytest.approx(w, rel=1e-14, abs=1e-15)


@pytest.mark.parametrize(("lattice", "spacing"), LATTICES)
def test_wave_vectors_lie_in_the_first_zone(
    lattice: Lattice, spacing: float | tuple[float, ...]
) -> None:
    a = np.asarray(spacing)
    k = wave_vectors(lattice, lattice.all_modes(), spacing)
    assert (np.abs(k * a) <= np.pi * (1 + 1e-15)).all()


def test_wave_vectors_of_labels() -> None:
    ring, chain = Lattice(CLOSED_CURVE, (6,)), Lattice(OPEN_CURVE, (6,))
    labels = [ModeLabel((p,), "cos") for p in range(4)]
    assert wave_vectors(ring, ModeSet.of(CLOSED_CURVE, labels))[:, 0] == pytest.approx(
        2 * np.pi * np.arange(4) / 6
    )
    assert wave_vectors(chain, ModeSet.of(OPEN_CURVE, labels), 2.0)[:, 0] == pytest.approx(
        np.pi * np.arange(4) / 12
    )
    with pytest.raises(ParameterError):
        wave_vectors(ring, ModeSet.of(CLOSED_CURVE, [ModeLabel((4,), "cos")]))


@given(k1=angle, k2=angle, turns=st.tuples(st.integers(-5, 5), st.integers(-5, 5)))
def test_nodes_cannot_tell_waves_of_other_zones(
    k1: float, k2: float, turns: tuple[int, int]
) -> None:
    lattice, a = Lattice(TORUS, (4, 4), (3.0, 0.5)), (0.5, 2.0)
    k = np.array([[k1, k2]]) / a
    beyond = k + 2 * np.pi * np.array([turns]) / a
    w = dispersion(lattice, k, a)
    assert dispersion(lattice, beyond, a) == pytest.approx(w, rel=1e-11, abs=1e-13)


@given(k=st.floats(1e-3, np.pi))
def test_chain_against_its_three_formulas(k: float) -> None:
    K, M, a = 3.0, 0.2, 0.7
    chain = Lattice(OPEN_CURVE, (2,), K, M)
    wave = np.array([[k / a]])
    w = 2 * np.sqrt(K / M) * np.sin(k / 2)
    assert dispersion(chain, wave, a)[0] == pytest.approx(w, rel=1e-14)
    assert phase_velocity(chain, wave, a)[0] == pytest.approx(w * a / k, rel=1e-14)
    assert group_velocity(chain, wave, a)[0, 0] == pytest.approx(
        a * np.sqrt(K / M) * np.cos(k / 2), rel=1e-13, abs=1e-15
    )


@given(k1=angle, k2=angle, k3=angle)
def test_group_velocity_is_the_gradient_of_the_frequency(k1: float, k2: float, k3: float) -> None:
    lattice, spacing = LATTICES[-1]
    a = np.asarray(spacing)
    k = np.array([[k1, k2, k3]]) / a
    if np.abs(k * a).max() < 0.2:
        return
    v, d = group_velocity(lattice, k, spacing)[0], 1e-4
    for axis in range(3):
        off = np.zeros((1, 3))
        off[0, axis] = d / a[axis]
        w = [dispersion(lattice, k + n * off, spacing)[0] for n in (-2, -1, 1, 2)]
        slope = (w[0] - 8 * w[1] + 8 * w[2] - w[3]) / (12 * d / a[axis])
        assert v[axis] == pytest.approx(slope, rel=1e-7, abs=1e-7)


def test_group_velocity_at_its_limits() -> None:
    chain, speed = Lattice(OPEN_CURVE, (4,), 9.0, 4.0), 1.5 * 2.0
    assert group_velocity(chain, np.zeros((1, 1)), 2.0)[0, 0] == speed
    assert phase_velocity(chain, np.zeros((1, 1)), 2.0)[0] == speed
    assert phase_velocity(chain, np.full((1, 1), 1e-200), 2.0)[0] == pytest.approx(speed)
    # At the edge of the zone a wave stands; against k it runs back.
    edge = np.array([[np.pi / 2.0]])
    assert group_velocity(chain, edge, 2.0)[0, 0] == pytest.approx(0, abs=1e-15)
    assert group_velocity(chain, -0.5 * edge, 2.0) == -group_velocity(chain, 0.5 * edge, 2.0)
    # On several axes a uniform shift goes nowhere.
    plane = Lattice(PLANE, (3, 3))
    assert group_velocity(plane, np.zeros((1, 2))).tolist() == [[0, 0]]
    assert phase_velocity(plane, np.zeros((1, 2))).tolist() == [0]


def test_long_waves_do_not_disperse() -> None:
    # Continuum limit: w = c k in every direction where K a^2 / M is the same along each axis.
    lattice, a = Lattice(PLANE, (2, 2), (4.0, 1.0)), (0.5, 1.0)
    k = 1e-6 * np.array([[1.0, 0.0], [0.6, 0.8], [0.0, -1.0]])
    assert phase_velocity(lattice, k, a) == pytest.approx([1.0] * 3, rel=1e-12)
    assert group_velocity(lattice, k, a) == pytest.approx(1e6 * k, rel=1e-11)


def test_what_does_not_fit_is_refused() -> None:
    lattice = Lattice(PLANE, (3, 3))
    with pytest.raises(ShapeError):
        dispersion(lattice, np.zeros((4, 1)))
    with pytest.raises(ShapeError):
        group_velocity(lattice, np.zeros(2))
    with pytest.raises(NonFiniteError, match="Wave vector 1"):
        phase_velocity(lattice, np.array([[0.0, 0.0], [np.nan, 1.0]]))
    for spacing in (0.0, -1.0, np.inf, (1.0,), (1.0, 0.0)):
        with pytest.raises(ParameterError):
            dispersion(lattice, np.zeros((1, 2)), spacing)


def test_speeds_are_numbers_where_stiffness_over_mass_is_none() -> None:
    usual = Lattice(PLANE, (4, 4), stiffness=(1.0, 3.0), mass=0.7)
    far = Lattice(PLANE, (4, 4), stiffness=(2.0**600, 3.0 * 2.0**600), mass=0.7 / 2.0**600)
    k = np.array([[0.3, 0.7], [1.0, 2.0]])
    assert (dispersion(far, k) == dispersion(usual, k) * 2.0**600).all()
