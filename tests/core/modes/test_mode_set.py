"""Labels, and shapes of the continuum at natural coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from dense_lattices import SURFACES, VOLUMES
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.modes import ModeLabel, ModeSet, lowest_modes
from modalmotion.modes.topologies import (
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    SPHERE,
    Topology,
)

TOPOLOGIES = (OPEN_CURVE, CLOSED_CURVE, *SURFACES, *VOLUMES)


def test_labels_read_back_as_modes() -> None:
    modes = lowest_modes(CUP, 20)
    assert ModeSet.of(CUP, modes.labels) == modes
    assert ModeSet.of(CUP, list(modes.labels)) == modes
    assert hash(ModeSet.of(CUP, modes.labels)) == hash(modes)
    assert modes != lowest_modes(CYLINDER, 20)
    assert modes != modes.take(slice(0, 19))
    assert modes != "modes"
    assert str(modes.labels[3]) == "(0, 1, sin)"
    assert modes.take([3, 0]).labels == (modes.labels[3], modes.labels[0])


def test_labels_cannot_be_written_over() -> None:
    modes = lowest_modes(CUP, 3)
    with pytest.raises(ValueError, match="read-only"):
        modes.wavenumbers[0, 0] = 7


def test_half_periods_of_the_poles() -> None:
    labels = [ModeLabel((r, p), "cos") for p in (0, 1, 2) for r in (0, 1, 2)]
    # cup: cos(r pi s) and sin((r + 1/2) pi s); sphere: cos(r pi s) and sin((r + 1) pi s).
    assert ModeSet.of(CUP, labels).half_periods[:, 0].tolist() == [0, 2, 4, 1, 3, 5, 0, 2, 4]
    assert ModeSet.of(SPHERE, labels).half_periods[:, 0].tolist() == [0, 2, 4, 2, 4, 6, 0, 2, 4]


def fine_grid(topology: Topology, n: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Midpoints of a grid of n cells along each axis."""
    axes = [(np.arange(n) + 0.5) / n for _ in topology.ends]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return grid.reshape(-1, topology.n_axes)


@pytest.mark.parametrize("topology", TOPOLOGIES, ids=str)
def test_shapes_are_orthonormal_in_the_mean(topology: Topology) -> None:
    # Few enough that the midpoint rule is exact.
    n = {1: 256, 2: 48, 3: 16}[topology.n_axes]
    modes = lowest_modes(topology, 25)
    V = modes.shapes_at(fine_grid(topology, n))
    assert np.abs(V.T @ V / len(V) - np.eye(len(modes))).max() <= 1e-13


@pytest.mark.parametrize("topology", [CUP, SPHERE])
def test_at_a_pole_every_mode_that_turns_is_zero(topology: Topology) -> None:
    modes = lowest_modes(topology, 60)
    theta = np.linspace(0, 1, 7)
    for s in (0.0,) if topology is CUP else (0.0, 1.0):
        V = modes.shapes_at(np.column_stack([np.full(7, s), theta]))
        turns = modes.wavenumbers[:, 1] != 0
        assert (V[:, turns] == 0.0).all()
        assert (np.ptp(V[:, ~turns], axis=0) == 0.0).all()
        assert (V[:, ~turns] != 0.0).all()


@pytest.mark.parametrize("topology", [CUP, SPHERE])
def test_even_waves_pass_the_pole_and_odd_ones_vanish_there(topology: Topology) -> None:
    # The factor is a smooth function through the pole only if it takes the sign of p'.
    modes = lowest_modes(topology, 40)
    near = modes.shapes_at(np.array([[1e-9, 0.1], [1e-9, 0.6]]))
    odd = modes.wavenumbers[:, 1] % 2 == 1
    assert np.abs(near[:, odd]).max() <= 1e-6
    assert near[0] == pytest.approx(near[1], abs=1e-6)


@given(phi=st.floats(-2, 2), seed=st.integers(0, 100))
def test_a_start_angle_only_turns_each_pair(phi: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for topology in (CLOSED_CURVE, CYLINDER, CUP, SPHERE):
        modes = lowest_modes(topology, 37)
        x = rng.uniform(0.05, 0.95, (50, topology.n_axes))
        here = modes.shapes_at(x)
        closed = topology.closed_axes[0]
        there = modes.shapes_at(x + phi * (np.arange(topology.n_axes) == closed))
        turn = 2 * np.pi * modes.wavenumbers[:, closed] * phi
        for i in np.flatnonzero(modes.is_sine):
            c, s = np.cos(turn[i]), np.sin(turn[i])
            cosine, sine = here[:, i - 1], here[:, i]
            assert np.abs(there[:, i - 1] - (c * cosine - s * sine)).max() <= 1e-11
            assert np.abs(there[:, i] - (s * cosine + c * sine)).max() <= 1e-11


@pytest.mark.parametrize("topology", TOPOLOGIES, ids=str)
def test_wavenumbers_are_those_of_the_laplacian(topology: Topology) -> None:
    modes = lowest_modes(topology, 12)
    x = np.random.default_rng(3).uniform(0.2, 0.8, (5, topology.n_axes))
    lengths = (1.7, 3.1, 0.9)[: topology.n_axes]
    laplacian, h = np.zeros((5, 12)), 1e-4
    for axis, length in enumerate(lengths):
        e = h * (np.arange(topology.n_axes) == axis)
        second = modes.shapes_at(x + e) - 2 * modes.shapes_at(x) + modes.shapes_at(x - e)
        laplacian += second / (h * length) ** 2
    k = modes.wavenumbers_on(lengths)
    assert -laplacian == pytest.approx(k**2 * modes.shapes_at(x), abs=1e-4 * k.max() ** 2)
