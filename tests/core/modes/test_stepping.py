"""The exact step: the same motion as the responses, however it is cut into steps."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator

import mpmath as mp
import numpy as np
import pytest
from numpy.typing import NDArray
from project import ROOT
from scipy.integrate import solve_ivp

from modalmotion.errors import NonFiniteError, ShapeError
from modalmotion.modes import (
    Oscillators,
    State,
    driven_states,
    energy,
    exact_step,
    free_response,
    phase_error,
)
from modalmotion.modes.lattice import Lattice, project
from modalmotion.modes.topologies import CUP, CYLINDER

_spec = importlib.util.spec_from_file_location(
    "extremes_oscillator_rows", ROOT / "tests" / "extremes" / "extremes_oscillator_rows.py"
)
assert _spec is not None
assert _spec.loader is not None
extremes = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(extremes)

EPS = np.finfo(np.float64).eps


@pytest.mark.parametrize("seed", range(3))
def test_a_step_under_a_linear_force_is_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(60):
        h = 10 ** rng.uniform(-4, 4)
        w = float(rng.choice([0.0, 10 ** rng.uniform(-6, 1)])) / h
        c = float(rng.choice([0.0, 2 * w, 10 ** rng.uniform(-6, 6) / h]))
        u0, v0, f0, f1 = rng.normal(size=4) / [1, h, h**2, h**2]
        step = exact_step(Oscillators(np.array([w]), c), h)
        end = step.advance(State(np.array([u0]), np.array([v0])), np.array([f0]), np.array([f1]))
        r = extremes.exact(w, c, h)
        with mp.workdps(60):
            g, S, R, A, B = (
                r[name][0] for name in ("impulse", "step", "ramp", "kept", "kept_velocity")
            )
            U, V, F, rise, H = (mp.mpf(x) for x in (u0, v0, f0, f1, h))
            rise -= F
            terms = ([A * U, g * V, S * F, R / H * rise], [-(mp.mpf(w) ** 2) * g * U, B * V, g * F])
            terms[1].append(S / H * rise)
            size = abs(r["kept"][1] * U) + abs(r["impulse"][1] * V) + abs(S * F) + abs(R / H * rise)
            speed = abs(r["kept_velocity"][1] * V) + abs(mp.mpf(w) ** 2 * r["impulse"][1] * U)
            speed += abs(r["impulse"][1] * F) + abs(S / H * rise)
            assert abs(mp.mpf(float(end.amplitudes[0])) - sum(terms[0])) <= 1e-14 * size
            assert abs(mp.mpf(float(end.velocities[0])) - sum(terms[1])) <= 1e-14 * speed


def test_a_step_is_the_free_response() -> None:
    rng = np.random.default_rng(2)
    w = np.concatenate([[0.0], 10 ** rng.uniform(-3, 3, 200)])
    o = Oscillators(w, rng.choice([0.0, 1.0, 30.0], 201) * w)
    start = State(rng.normal(size=(201, 3)), w[:, None] * rng.normal(size=(201, 3)))
    end = exact_step(o, 0.37).advance(start)
    whole = free_response(o, np.array([0.37]), start)
    size = np.abs(start.amplitudes) + np.abs(start.velocities) * 0.37 + 1e-300
    assert (np.abs(end.amplitudes - whole.amplitudes[0]) <= 2e-15 * size).all()


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("turn", "n_steps"), [(8e-4, 12_500), (1e-2, 1000), (0.3, 2000), (1.0, 5000), (2.9, 3000)]
)
def test_many_steps_are_as_exact_as_one(turn: float, n_steps: int) -> None:
    rng = np.random.default_rng(int(n_steps))
    h = 0.125
    w = turn * rng.uniform(0.5, 1, 64) / h
    o, step = Oscillators(w), exact_step(Oscillators(w), h)
    state = start = State(rng.normal(size=64), w * rng.normal(size=64))
    for _ in range(n_steps):
        state = step.advance(state)
    t = np.array([n_steps * h])
    whole = free_response(o, t, start)
    bound = np.sqrt(2 * energy(o, start)) * np.maximum(1e-14, phase_error(o, t)[0])
    assert (np.abs(state.amplitudes - whole.amplitudes[0]) * w <= bound).all()
    assert (np.abs(state.velocities - whole.velocities[0]) <= bound).all()


def test_rounding_is_handed_on_from_step_to_step() -> None:
    h, w = 0.125, np.linspace(0.8e-3, 1.6e-3, 64)
    step, o = exact_step(Oscillators(w), h), Oscillators(w)
    careful = careless = start = State(np.ones(64), w)
    for _ in range(20_000):
        careful = step.advance(careful)
        careless = step.advance(State(careless.amplitudes, careless.velocities))
    whole = free_response(o, np.array([2500.0]), start).amplitudes[0]
    assert np.abs(careful.amplitudes - whole).max() <= 1e-15
    assert np.abs(careless.amplitudes - whole).max() >= 5e-15


def plain_drift(turns: NDArray[np.float64]) -> float:
    """Energy change per step, in eps, when each coefficient is merely rounded."""
    c, s = np.cos(turns), np.sin(turns)
    u, v = np.full_like(turns, 0.6), np.full_like(turns, -0.8)
    for _ in range(3000):
        u, v = c * u + s * v, c * v - s * u
    return float(np.abs(u**2 + v**2 - 1).max() / (3000 * EPS))


def test_energy_of_the_undamped_oscillator() -> None:
    turns = np.concatenate([np.logspace(-6, 4, 400), np.pi / 2 * np.arange(1, 9)])
    assert extremes.energy_drift(3000, turns) <= 1.5
    assert extremes.energy_drift(3000, np.linspace(0.1, 6.3, 5000)) <= 0.7
    # Small steps are where a rounded cosine leaks most for its length.
    small = np.linspace(1e-3, 3e-2, 200)
    assert extremes.energy_drift(3000, small) <= 0.01
    assert plain_drift(small) >= 0.3


@pytest.mark.soak
def test_energy_over_a_million_steps() -> None:
    turns = np.concatenate([np.logspace(-6, 4, 1000), np.linspace(0.01, 6.3, 1000)])
    assert extremes.energy_drift(1_000_000, turns) <= 4.0


def test_constant_force_ends_at_rest_whatever_the_steps() -> None:
    w, f = np.array([0.5, 3.0, 40.0]), np.array([1.0, -2.0, 3.0])
    for h, n_steps in ((0.05, 12_000), (1.0, 800), (1e6, 1)):
        step = exact_step(Oscillators(w, 0.3 * w), h)
        state = State(np.ones(3), np.ones(3))
        for _ in range(n_steps):
            state = step.advance(state, f, f)
        assert state.amplitudes == pytest.approx(f / w**2, rel=3e-15, abs=0)


def test_forces_linear_between_frames_agree_with_a_numerical_integration() -> None:
    rng = np.random.default_rng(8)
    w, c, h = np.array([0.0, 1.0, 4.0]), np.array([0.2, 0.1, 20.0]), 0.5
    forces = rng.normal(size=(13, 3))

    def rates(t: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        f = np.array([np.interp(t, h * np.arange(13), forces[:, m]) for m in range(3)])
        return np.concatenate([y[3:], f - c * y[3:] - w**2 * y[:3]])

    slow = [np.array([1.0, 0.0, -1.0, 0.0, 1.0, 0.0])]
    for frame in range(12):
        # Frame by frame: the force has a corner at each.
        span = (frame * h, (frame + 1) * h)
        slow.append(
            solve_ivp(rates, span, slow[-1], method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        )
    start = State(slow[0][:3], slow[0][3:])
    states = list(driven_states(exact_step(Oscillators(w, c), h), iter(forces), start))
    assert len(states) == 13
    assert np.array_equal(states[0].amplitudes, start.amplitudes)
    fast = np.array([np.concatenate([s.amplitudes, s.velocities]) for s in states])
    assert fast == pytest.approx(np.array(slow), rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("topology", [CYLINDER, CUP])
def test_modes_driven_by_forces_at_nodes_are_the_driven_lattice(topology: object) -> None:
    lattice = Lattice(CYLINDER if topology == CYLINDER else CUP, (3, 4), stiffness=2.0, mass=0.7)
    modes = lattice.all_modes()
    shapes, w = lattice.shapes(modes), lattice.angular_frequencies(modes)
    rng = np.random.default_rng(3)
    F = rng.normal(size=(12, 3))
    # K from its own modes: M u'' = F - K u, node by node.
    K = 0.7 * (shapes * w**2) @ shapes.T / 12

    def rates(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        u, v = y.reshape(2, 12, 3)
        return np.concatenate([v.ravel(), ((F - K @ u) / 0.7).ravel()])

    slow = solve_ivp(rates, (0, 3.0), np.zeros(72), method="DOP853", rtol=1e-11, atol=1e-12)
    f = project(lattice, modes, F[None])[0] / 0.7
    at_rest = State(np.zeros((12, 3)), np.zeros((12, 3)))
    end = exact_step(Oscillators(w), 3.0).advance(at_rest, f, f)
    assert shapes @ end.amplitudes == pytest.approx(
        slow.y[:36, -1].reshape(12, 3), rel=1e-8, abs=1e-8
    )


def test_a_uniform_force_moves_the_whole_lattice_only() -> None:
    lattice = Lattice(CUP, (5, 6), mass=2.0)
    f = project(lattice, lattice.all_modes(), np.full((1, 30, 3), 7.0))[0] / 2.0
    assert f[0] == pytest.approx([3.5] * 3)
    assert np.abs(f[1:]).max() <= 1e-14


def test_forces_are_taken_one_by_one() -> None:
    taken = []

    def forces() -> Iterator[NDArray[np.float64]]:
        for frame in range(1000):
            taken.append(frame)
            yield np.ones(2)

    states = driven_states(
        exact_step(Oscillators(np.ones(2)), 0.1), forces(), State(np.zeros(2), np.zeros(2))
    )
    for _ in range(3):
        next(states)
    assert taken == [0, 1, 2]


def test_what_does_not_fit_is_refused() -> None:
    step = exact_step(Oscillators(np.ones(2)), 0.1)
    start = State(np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(ShapeError):
        step.advance(State(np.zeros(3), np.zeros(3)))
    with pytest.raises(ShapeError):
        step.advance(start, np.zeros((2, 3)), np.zeros(2))
    bad = np.zeros((3, 2, 3))
    bad[1, 0, 2] = np.nan
    with pytest.raises(NonFiniteError) as caught:
        list(driven_states(step, bad, start))
    assert caught.value.frame == 1
