"""Waves on lattices: free motion from any start, against the lattice's own equations."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.modes import (
    ModeLabel,
    State,
    energy,
    free_states,
    group_velocity,
    modal_state,
    mode_oscillators,
    phase_velocity,
    propagate,
    travelling_wave,
    wave_vectors,
)
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CLOSED, CLOSED_CURVE, CUP, CYLINDER, OPEN_CURVE, PLANE, TORUS

TOPOLOGIES = [OPEN_CURVE, CLOSED_CURVE, PLANE, CYLINDER, TORUS]


def neighbour_force(lattice: Lattice, u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Force of the springs on every node, spring by spring."""
    u = u.reshape(lattice.shape)
    force = np.zeros_like(u)
    for axis, (ends, K) in enumerate(zip(lattice.topology.ends, lattice.stiffnesses, strict=True)):
        stretch = K * np.diff(u, axis=axis, append=np.take(u, [0], axis=axis))
        if ends != CLOSED:
            last = [slice(None)] * u.ndim
            last[axis] = slice(-1, None)
            stretch[tuple(last)] = 0.0
        force += stretch - np.roll(stretch, 1, axis=axis)
    return force.ravel()


def small(topology: object) -> Lattice:
    n_axes = len(getattr(topology, "ends", ()))
    chosen = next(t for t in TOPOLOGIES if t == topology)
    return Lattice(chosen, (5, 4)[:n_axes], (2.0, 0.6)[:n_axes], 0.7)


@pytest.mark.every(3)
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_motion_of_all_modes_is_the_motion_of_the_lattice(topology: object) -> None:
    lattice = small(topology)
    n, rng = lattice.n_nodes, np.random.default_rng(1)
    u0, v0 = rng.normal(size=n), rng.normal(size=n)
    modes, times = lattice.all_modes(), np.array([0.0, 0.4, 2.0, 9.0])

    def rates(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        force = neighbour_force(lattice, y[:n]) / lattice.mass
        return np.concatenate([y[n:], force - 0.1 * y[n:]])

    slow = solve_ivp(
        rates,
        (0, 9),
        np.concatenate([u0, v0]),
        t_eval=times,
        method="DOP853",
        rtol=1e-11,
        atol=1e-12,
    )
    start = modal_state(lattice, modes, u0, v0)
    for frame, u in enumerate(propagate(lattice, modes, start, times, damping=0.1)):
        assert u == pytest.approx(slow.y[:n, frame], rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("topology", [*TOPOLOGIES, CUP])
def test_all_modes_start_exactly_where_they_were_told(topology: object) -> None:
    lattice = Lattice(CUP, (5, 4)) if topology == CUP else small(topology)
    rng = np.random.default_rng(2)
    u0, v0 = rng.normal(size=(2, lattice.n_nodes, 3))
    modes = lattice.all_modes()
    start = modal_state(lattice, modes, u0, v0)
    (again,) = propagate(lattice, modes, start, np.zeros(1))
    assert np.abs(again - u0).max() <= 1e-14
    # Parseval: with shapes of mean square 1, means over nodes are sums over modes.
    assert (start.amplitudes**2).sum() == pytest.approx((u0**2).sum() / len(u0), rel=1e-14)
    assert lattice.shapes(modes) @ start.velocities == pytest.approx(v0, abs=1e-14)


def test_energy_is_conserved_and_is_the_lattices_own() -> None:
    lattice = Lattice(CYLINDER, (6, 8), (2.0, 0.6), 0.7)
    rng = np.random.default_rng(3)
    u0, v0 = rng.normal(size=(2, 48))
    modes = lattice.all_modes()
    start, oscillators = modal_state(lattice, modes, u0, v0), mode_oscillators(lattice, modes)
    own = 0.5 * (v0 @ v0) * lattice.mass - 0.5 * (u0 @ neighbour_force(lattice, u0))
    # Per unit mass and node in the modes.
    assert energy(oscillators, start).sum() * lattice.mass * 48 == pytest.approx(own, rel=1e-14)
    for state in free_states(oscillators, np.array([1.0, 1e3, 1e6]), start):
        assert energy(oscillators, state) == pytest.approx(energy(oscillators, start), rel=5e-14)


def test_a_travelling_wave_moves_with_the_phase_velocity() -> None:
    n, p, a = 24, 3, 0.5
    ring = Lattice(CLOSED_CURVE, (n,), 2.0, 0.3)
    modes, start = travelling_wave(ring, ModeLabel((p,), "cos"))
    k = wave_vectors(ring, modes, a)
    speed = phase_velocity(ring, k, a)[0]
    x = a * np.arange(1, n + 1)
    for t in (0.0, 0.37, 2.0, 100.0):
        (u,) = propagate(ring, modes, start, np.array([t]))
        expected = np.sqrt(2) * np.cos(k[0, 0] * (x - speed * t))
        assert u == pytest.approx(expected, abs=1e-12)
    # After one node's time the wave has moved by one node, unchanged.
    (later,) = propagate(ring, modes, start, np.array([a / speed]))
    (now,) = propagate(ring, modes, start, np.zeros(1))
    assert later == pytest.approx(np.roll(now, 1), abs=1e-14)
    _, back = travelling_wave(ring, ModeLabel((p,), "sin"), backwards=True)
    (earlier,) = propagate(ring, modes, back, np.array([a / speed]))
    assert earlier == pytest.approx(np.roll(now, -1), abs=1e-14)


def test_a_travelling_wave_on_a_torus_and_on_a_cylinder() -> None:
    torus = Lattice(TORUS, (6, 8), (2.0, 0.6))
    modes, start = travelling_wave(torus, ModeLabel((1, -2), "cos"))
    w = torus.angular_frequencies(modes)[0]
    node = np.indices((6, 8)) + 1
    phase = 2 * np.pi * (node[0] / 6 - 2 * node[1] / 8)
    (u,) = propagate(torus, modes, start, np.array([0.8]))
    assert u.reshape(6, 8) == pytest.approx(np.sqrt(2) * np.cos(phase - 0.8 * w), abs=1e-13)

    cylinder = Lattice(CYLINDER, (5, 8), (2.0, 0.6))
    modes, start = travelling_wave(cylinder, ModeLabel((2, 1), "cos"))
    w = cylinder.angular_frequencies(modes)[0]
    (now,) = propagate(cylinder, modes, start, np.zeros(1))
    (later,) = propagate(cylinder, modes, start, np.array([2 * np.pi / w / 8]))
    assert later.reshape(5, 8) == pytest.approx(np.roll(now.reshape(5, 8), 1, axis=1), abs=1e-14)


@pytest.mark.parametrize(
    ("lattice", "label"),
    [
        (Lattice(OPEN_CURVE, (6,)), ModeLabel((2,), "cos")),
        (Lattice(CLOSED_CURVE, (6,)), ModeLabel((0,), "cos")),
        (Lattice(CLOSED_CURVE, (6,)), ModeLabel((3,), "cos")),
        (Lattice(CYLINDER, (4, 6)), ModeLabel((2, 0), "cos")),
        (Lattice(TORUS, (4, 6)), ModeLabel((2, 3), "cos")),
    ],
)
def test_waves_without_a_partner_stand(lattice: Lattice, label: ModeLabel) -> None:
    with pytest.raises(ParameterError, match="stands") as caught:
        travelling_wave(lattice, label)
    assert caught.value.details["label"] == str(label)


def test_a_travelling_wave_keeps_its_energy_in_each_mode_in_turn() -> None:
    ring = Lattice(CLOSED_CURVE, (12,))
    modes, start = travelling_wave(ring, ModeLabel((2,), "cos"))
    oscillators = mode_oscillators(ring, modes)
    w = oscillators.angular_frequencies[0]
    for state in free_states(oscillators, np.linspace(0, 50, 40), start):
        # Quadrature: both modes carry w^2 / 2 at all times, and the radius is 1.
        assert energy(oscillators, state) == pytest.approx([w**2 / 2] * 2, rel=1e-13)
        assert np.hypot(*state.amplitudes) == pytest.approx(1, rel=1e-13)


def test_a_pulse_moves_with_the_group_velocity() -> None:
    n, ka = 600, 1.2
    ring = Lattice(CLOSED_CURVE, (n,), 2.0, 0.5)
    modes = ring.all_modes()
    x = np.arange(1, n + 1) - 150.0
    # A packet of 24 nodes about k: displacement and velocity of waves that all run forwards.
    packet = np.exp(-0.5 * (x / 24) ** 2 + 1j * ka * x)
    spectrum, k = np.fft.fft(packet), 2 * np.pi * np.fft.fftfreq(n)
    w = 2 * np.sqrt(2.0 / 0.5) * np.abs(np.sin(k / 2))
    velocity = np.fft.ifft(-1j * w * spectrum).real
    start = modal_state(ring, modes, packet.real, velocity)
    v = group_velocity(ring, np.array([[ka]]))[0, 0]
    w_0 = 2 * 2.0 * np.sin(ka / 2)
    centres = []
    times = np.array([0.0, 50.0, 100.0, 150.0])
    states = free_states(mode_oscillators(ring, modes), times, start)
    shapes = ring.shapes(modes)
    for state in states:
        u, u_dot = shapes @ state.amplitudes, shapes @ state.velocities
        local = u_dot**2 + (w_0 * u) ** 2
        centres.append(float((local @ x) / local.sum()))
    speeds = np.diff(centres) / 50.0
    assert speeds == pytest.approx([v] * 3, rel=5e-3)
    # The phase velocity is another one.
    assert phase_velocity(ring, np.array([[ka]]))[0] > 1.1 * v


def test_few_modes_move_as_the_slow_part_of_the_lattice() -> None:
    lattice = Lattice(CYLINDER, (8, 12))
    few, rng = lattice.whole_modes(7), np.random.default_rng(5)
    u0, v0 = rng.normal(size=(2, 96, 3))
    times = np.array([0.0, 3.0])
    part = modal_state(lattice, few, u0, v0)
    whole = modal_state(lattice, lattice.all_modes(), u0, v0)
    assert whole.amplitudes[:7] == pytest.approx(part.amplitudes, rel=1e-12, abs=1e-15)
    moved = [*propagate(lattice, few, part, times)]
    assert moved[0].shape == (96, 3)
    shapes = lattice.shapes(few)
    exact = [*propagate(lattice, lattice.all_modes(), whole, times)][1]
    assert shapes.T @ moved[1] == pytest.approx(shapes.T @ exact, abs=1e-11)


def test_what_does_not_fit_is_refused() -> None:
    lattice = Lattice(CYLINDER, (3, 4))
    modes = lattice.all_modes()
    with pytest.raises(ShapeError):
        modal_state(lattice, modes, np.zeros(11), np.zeros(11))
    with pytest.raises(ShapeError):
        modal_state(lattice, modes, np.zeros(12), np.zeros((12, 3)))
    with pytest.raises(ShapeError):
        list(propagate(lattice, modes, State(np.zeros(5), np.zeros(5)), np.zeros(1)))
