"""Waves on lattices: free motion from any start, against the lattice's own equations."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from modalmotion.modes import (
    ModeLabel,
    ModeSet,
    Oscillators,
    State,
    energy,
    free_response,
    group_velocity,
    phase_velocity,
    wave_vectors,
)
from modalmotion.modes.lattice import Lattice, project
from modalmotion.modes.topologies import (
    CLOSED,
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    TORUS,
)

Array = NDArray[np.float64]
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


def modal_state(lattice: Lattice, modes: ModeSet, u: Array, v: Array) -> State:
    """The amplitudes of displacements and velocities, (nodes, ...) each."""
    a, b = (project(lattice, modes, x.reshape(1, lattice.n_nodes, -1))[0] for x in (u, v))
    return State(a.reshape(-1, *u.shape[1:]), b.reshape(-1, *v.shape[1:]))


def propagate(
    lattice: Lattice, modes: ModeSet, start: State, times: Array, damping: float = 0.0
) -> Array:
    """Displacements at each time, (times, nodes, ...)."""
    oscillators = Oscillators(lattice.angular_frequencies(modes), damping)
    moved, shapes = free_response(oscillators, times, start).amplitudes, lattice.shapes(modes)
    return np.stack([shapes @ a for a in moved])


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
    start = modal_state(lattice, modes, u0, v0)
    oscillators = Oscillators(lattice.angular_frequencies(modes))
    own = 0.5 * (v0 @ v0) * lattice.mass - 0.5 * (u0 @ neighbour_force(lattice, u0))
    # Per unit mass and node in the modes.
    assert energy(oscillators, start).sum() * lattice.mass * 48 == pytest.approx(own, rel=1e-14)
    later = free_response(oscillators, np.array([1.0, 1e3, 1e6]), start)
    for state in map(State, later.amplitudes, later.velocities):
        assert energy(oscillators, state) == pytest.approx(energy(oscillators, start), rel=5e-14)


def test_a_cosine_and_its_sine_travel_with_the_phase_velocity() -> None:
    n, p, a = 24, 3, 0.5
    ring = Lattice(CLOSED_CURVE, (n,), 2.0, 0.3)
    modes = ModeSet.of(CLOSED_CURVE, [ModeLabel((p,), "cos"), ModeLabel((p,), "sin")])
    w = ring.angular_frequencies(modes)
    start = State(np.array([1.0, 0.0]), np.array([0.0, w[1]]))
    k = wave_vectors(ring, modes, a)
    speed = phase_velocity(ring, k, a)[0]
    x = a * np.arange(1, n + 1)
    times = np.array([0.0, 0.37, 2.0, 100.0, a / speed])
    moved = propagate(ring, modes, start, times)
    for t, u in zip(times, moved, strict=True):
        assert u == pytest.approx(np.sqrt(2) * np.cos(k[0, 0] * (x - speed * t)), abs=1e-12)
    # After one node's time the wave has moved by one node, unchanged.
    assert moved[4] == pytest.approx(np.roll(moved[0], 1), abs=1e-14)


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
    later = free_response(Oscillators(ring.angular_frequencies(modes)), times, start)
    shapes = ring.shapes(modes)
    for state in map(State, later.amplitudes, later.velocities):
        u, u_dot = shapes @ state.amplitudes, shapes @ state.velocities
        local = u_dot**2 + (w_0 * u) ** 2
        centres.append(float((local @ x) / local.sum()))
    speeds = np.diff(centres) / 50.0
    assert speeds == pytest.approx([v] * 3, rel=5e-3)
    # The phase velocity is another one.
    assert phase_velocity(ring, np.array([[ka]]))[0] > 1.1 * v
