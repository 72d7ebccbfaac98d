"""Laws that projection and superposition obey."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.modes import ModeLabel
from modalmotion.modes.lattice import Lattice, project, superpose
from modalmotion.modes.topologies import CLOSED_CURVE, CUP, CYLINDER, PLANE, SPHERE, TORUS, Topology

SURFACES = (PLANE, CYLINDER, TORUS, CUP, SPHERE)

topologies = st.sampled_from(SURFACES)
shapes = st.tuples(st.integers(1, 12), st.integers(1, 7).map(lambda n: 2 * n))


@given(topology=topologies, shape=shapes, seed=st.integers(0, 1000), data=st.data())
def test_project_after_superpose_gives_the_amplitudes_back(
    topology: Topology, shape: tuple[int, int], seed: int, data: st.DataObject
) -> None:
    lattice = Lattice(topology, shape)
    modes = lattice.lowest_modes(data.draw(st.integers(1, lattice.n_nodes)))
    a = np.random.default_rng(seed).standard_normal((3, len(modes), 3))
    assert np.abs(project(lattice, modes, superpose(lattice, modes, a)) - a).max() <= 1e-13


@given(topology=topologies, shape=shapes, seed=st.integers(0, 1000))
def test_parseval(topology: Topology, shape: tuple[int, int], seed: int) -> None:
    lattice = Lattice(topology, shape)
    u = np.random.default_rng(seed).standard_normal((2, lattice.n_nodes, 3))
    a = project(lattice, lattice.all_modes(), u)
    assert (a**2).sum(axis=1) == pytest.approx((u**2).mean(axis=1), rel=1e-13)


@given(topology=topologies, shape=shapes, kept=st.integers(1, 20), seed=st.integers(0, 1000))
def test_what_is_left_is_what_was_dropped(
    topology: Topology, shape: tuple[int, int], kept: int, seed: int
) -> None:
    lattice = Lattice(topology, shape)
    modes = lattice.lowest_modes(min(kept, lattice.n_nodes))
    u = np.random.default_rng(seed).standard_normal((1, lattice.n_nodes, 1))
    every = project(lattice, lattice.all_modes(), u)
    left = u - superpose(lattice, modes, project(lattice, modes, u))
    assert (left**2).mean() == pytest.approx((every[:, len(modes) :] ** 2).sum(), abs=1e-13)
    # And it is orthogonal to what was kept.
    assert np.abs(project(lattice, modes, left)).max() <= 1e-13


@given(
    topology=topologies,
    shape=shapes,
    t=st.tuples(*[st.floats(-1e6, 1e6, allow_subnormal=False)] * 3),
)
def test_a_translation_excites_only_mode_0(
    topology: Topology, shape: tuple[int, int], t: tuple[float, float, float]
) -> None:
    lattice = Lattice(topology, shape)
    u = np.broadcast_to(np.array(t), (1, lattice.n_nodes, 3))
    a = project(lattice, lattice.all_modes(), u)
    rounding = 64 * np.finfo(np.float64).eps * max(map(abs, t))
    assert np.abs(a[0, 0] - t).max() <= rounding
    assert np.abs(a[0, 1:]).max(initial=0.0) <= rounding


@pytest.mark.parametrize(
    ("topology", "axis"), [(CLOSED_CURVE, 0), (CYLINDER, 1), (CUP, 1), (SPHERE, 1), (TORUS, 1)]
)
@pytest.mark.parametrize("places", [1, 5, 17])
def test_another_first_node_only_turns_each_pair(
    topology: Topology, axis: int, places: int, rng: np.random.Generator
) -> None:
    shape = (14, 24)[-topology.n_axes :]
    lattice = Lattice(topology, shape)
    modes = lattice.whole_modes(30 if topology.n_axes == 2 else 13)
    u = rng.standard_normal((2, *shape, 3))
    moved = np.roll(u, -places, axis=1 + axis).reshape(2, -1, 3)
    before = project(lattice, modes, u.reshape(2, -1, 3))
    after = project(lattice, modes, moved)
    phase = 2 * np.pi * modes.wavenumbers[:, axis] * places / shape[axis]
    sine = np.flatnonzero(modes.is_sine)
    single = np.setdiff1d(np.arange(len(modes)), np.concatenate([sine, sine - 1]))
    c, s = np.cos(phase[sine])[:, None], np.sin(phase[sine])[:, None]
    a, b = before[:, sine - 1], before[:, sine]
    assert np.abs(after[:, sine - 1] - (c * a + s * b)).max() <= 1e-14
    assert np.abs(after[:, sine] - (c * b - s * a)).max() <= 1e-14
    assert np.abs(after[:, single] - before[:, single]).max(initial=0.0) <= 1e-14


@pytest.mark.parametrize("topology", [CLOSED_CURVE, CYLINDER, CUP, SPHERE])
def test_reversed_orientation_flips_the_sines_only(
    topology: Topology, rng: np.random.Generator
) -> None:
    shape = (14, 24)[-topology.n_axes :]
    lattice = Lattice(topology, shape)
    modes = lattice.all_modes()
    u = rng.standard_normal((2, *shape, 3))
    # theta -> -theta keeps node N, at angle 0, where it is.
    mirrored = np.roll(u[..., ::-1, :], -1, axis=-2)
    before = project(lattice, modes, u.reshape(2, -1, 3))
    after = project(lattice, modes, mirrored.reshape(2, -1, 3))
    sign = np.where(modes.is_sine, -1.0, 1.0)[:, None]
    assert np.abs(after - sign * before).max() <= 1e-14


@pytest.mark.parametrize("topology", [TORUS, CYLINDER, SPHERE])
def test_a_checkerboard_lands_in_one_mode(topology: Topology) -> None:
    shape = (8, 6)
    lattice = Lattice(topology, shape)
    modes = lattice.all_modes()
    if topology is TORUS:
        u = (-1.0) ** np.add.outer(np.arange(8), np.arange(6))
        label = ModeLabel((4, 3), "cos")
    elif topology is CYLINDER:
        # The highest shape of an open chain alternates too, under an envelope.
        n = np.arange(8)
        u = np.sqrt(2) * np.outer(np.cos(7 * np.pi * (2 * n + 1) / 16), (-1.0) ** np.arange(6))
        label = ModeLabel((7, 3), "cos")
    else:
        u = (-1.0) ** np.add.outer(np.arange(8), np.arange(6))
        label = ModeLabel((7, 3), "cos")
    a = project(lattice, modes, u.reshape(1, -1, 1))[0, :, 0]
    hit = modes.labels.index(label)
    assert abs(a[hit]) == pytest.approx(1.0, rel=1e-14)
    assert np.abs(np.delete(a, hit)).max() <= 1e-15
