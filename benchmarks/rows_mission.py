"""Rows of the table of truth: what the method of Nastar (1994) promises."""

from __future__ import annotations

import importlib
import time
from functools import partial

import mpmath as mp
import numpy as np
from experiments import Row, experiment
from extremes import SECTIONS, rows_of
from measure import beside_numpy, side_by_side
from sparse_lattices import stiffness_matrix

import modalmotion as mm
from modalmotion.dynamics import Oscillators, State, driven_states, exact_step, mode_oscillators
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CLOSED_CURVE, CYLINDER, OPEN_CURVE, PLANE, TORUS
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.tracking import track

INDIVIDUAL = VentricleParameters(shape_variation=2.0, motion_variation=2.0)


@experiment(
    Row("mission.extremes.missed", "numerical extremes out of their bounds", goal=0, tolerance=0),
    Row("mission.extremes.error", "largest error over its bound", goal=1, tolerance=0.1),
    quick=True,
)
def extremes(_: int) -> tuple[float, float]:
    errors = [(row[2](), row[3]) for _, module in SECTIONS for row in rows_of(module)]
    ratios = [error / bound if bound else float(error > 0) * 1e9 for error, bound in errors]
    return sum(not ratio <= 1 for ratio in ratios), max(ratios)


@experiment(
    Row(
        "mission.closed_forms.error",
        "modes of the paper's chains and surfaces: largest |K phi - M w^2 phi| over K",
        goal=1e-14,
        tolerance=1e-15,
    ),
    quick=True,
)
def closed_forms(_: int) -> float:
    worst = 0.0
    for topology in (OPEN_CURVE, CLOSED_CURVE, PLANE, CYLINDER, TORUS):
        lattice = Lattice(topology, (40, 100)[: len(topology.ends)])
        modes = lattice.lowest_modes(120 if len(topology.ends) > 1 else 40)
        phi, squares = lattice.shapes(modes), lattice.angular_frequencies(modes) ** 2
        worst = max(worst, float(np.abs(stiffness_matrix(lattice) @ phi - phi * squares).max()))
    return worst


@experiment(
    Row(
        "mission.forced.error",
        "eq. 3 under a force that grows, undamped to 1e8 times critical: largest relative error",
        goal=1e-14,
        tolerance=1e-15,
    ),
    quick=True,
)
def forced(_: int) -> float:
    rows_of("extremes_oscillator_rows")
    exact = importlib.import_module("extremes_oscillator_rows").exact
    worst = 0.0
    for w in (0.0, 1e-9, 0.7, 30.0):
        for c in (0.0, 1e-9, 0.3, 1.4, 1.4 * (1 + 1e-9), 60.0, 1e4, 1e8):
            parts = exact(w, c, 1.3)
            step = exact_step(Oscillators(np.array([w]), c), 1.3)
            start = State(np.array([0.4]), np.array([-0.2]))
            found = step.advance_forced(start, np.array([0.5]), np.array([2.1])).amplitudes[0]
            shares = {"kept": 0.4, "impulse": -0.2, "step": 0.5, "ramp": (2.1 - 0.5) / 1.3}
            terms = [parts[name][0] * mp.mpf(share) for name, share in shares.items()]
            size = sum(parts[name][1] * abs(share) for name, share in shares.items())
            worst = max(worst, float(abs(mp.mpf(float(found)) - sum(terms)) / size))
    return worst


@experiment(
    Row(
        "mission.rest_point.distance",
        "tracked surface from where eq. 3 comes to rest under the data's force",
        "mm",
        goal=1e-5,
    ),
    quick=True,
)
def rest_point(seed: int) -> float:
    beat = simulate_ventricle(
        INDIVIDUAL,
        grid=(12, 24),
        acquisition=Acquisition(n_frames=6, noise=0.5),
        rng=np.random.default_rng([seed, 1]),
    )
    start = mm.mesh_sequence(beat.vertices[:1], beat.faces, topology="cup", unit="mm")
    clouds = list(beat.vertices)
    solved, driven = (
        track(clouds, start=start, modes=7, unit="mm", dynamics=way) for way in (False, True)
    )
    return float(np.abs(driven.driven_vertices(-1) - solved.sequence.vertices).max())


@experiment(
    Row(
        "mission.animation.ratio",
        "300 frames of seven driven modes: time on a million nodes over that on a thousand",
        goal=1.5,
    ),
    quick=True,
    is_timed=True,
)
def animation(seed: int) -> float:
    forces = np.random.default_rng([seed, 2]).standard_normal((300, 7, 3))

    def animate(lattice: Lattice) -> None:
        step = exact_step(mode_oscillators(lattice, lattice.lowest_modes(7), 0.1), 0.04)
        still = State(np.zeros((7, 3)), np.zeros((7, 3)))
        for _ in driven_states(step, list(forces), still):
            pass

    sizes = {"few": (20, 50), "many": (1000, 1000)}
    calls = {name: partial(animate, Lattice(CYLINDER, shape)) for name, shape in sizes.items()}
    times = side_by_side(calls, 9, time.process_time, 0.02)
    return times["many"].median / times["few"].median


AMPLITUDES = (3, 21, 51)
COUNTS = (3, 7, 21, 54)


@experiment(
    *(
        Row(
            f"mission.compression.{n}",
            f"coordinates over amplitudes of 4,000 vertices by {n} amplitudes",
            goal=round(12_000 / n, 3) - 0.001,
            better="higher",
            tolerance=0,
        )
        for n in AMPLITUDES
    ),
    quick=True,
)
def compression(_: int) -> tuple[float, ...]:
    beat = simulate_ventricle(grid=(40, 100), acquisition=Acquisition(n_frames=2))
    asked = (mm.SignatureParameters(amplitudes=n, split_pairs=True) for n in AMPLITUDES)
    return tuple(mm.modal_signature(beat, each).compression for each in asked)


@experiment(
    *(
        Row(f"mission.left.{n}", f"RMS that {n} modes leave of a simulated heart's motion", "mm")
        for n in COUNTS
    ),
    quick=True,
)
def left(seed: int) -> tuple[float, ...]:
    beat = _beat(seed)
    return tuple(
        mm.modal_signature(beat, mm.SignatureParameters(modes=n)).rms_error for n in COUNTS
    )


@experiment(
    *(
        Row(
            f"mission.time.{n}",
            f"signature of {n} modes, 25 frames of 4,000 vertices, over NumPy work",
        )
        for n in COUNTS
    ),
    is_timed=True,
)
def times(seed: int) -> tuple[float, ...]:
    beat = _beat(seed)
    calls = {
        str(n): partial(mm.modal_signature, beat, mm.SignatureParameters(modes=n)) for n in COUNTS
    }
    return tuple(beside_numpy(calls).values())


def _beat(seed: int) -> mm.MeshSequence:
    return simulate_ventricle(INDIVIDUAL, n_vertices=4000, rng=np.random.default_rng([seed, 3]))
