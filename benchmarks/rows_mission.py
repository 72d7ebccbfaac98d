"""Rows of the table of truth: what the method of Nastar (1994) promises."""

from __future__ import annotations

from functools import partial

import numpy as np
from exact_solutions import apart_at_rest, forced_error, largest_residual
from experiments import Row, quick, rows, timed
from extremes import SECTIONS
from measure import beside_numpy, medians
from noisy_surfaces import individual

import modalmotion as mm
from modalmotion.modes import Oscillators, State, driven_states, exact_step
from modalmotion.signature.value import first_modes

COUNTS, OF_VERTICES = (3, 7, 21, 54), "of 4,000 vertices by"


@quick(
    Row("mission.extremes.missed", "numerical extremes out of their bounds", goal=0, tolerance=0),
    Row("mission.extremes.error", "largest error over its bound", goal=1, tolerance=0.1),
)
def extremes(_: int) -> tuple[float, float]:
    pairs = [(row[2](), row[3]) for of_section in SECTIONS.values() for row in of_section]
    ratios = [error / bound if bound else float(error > 0) * 1e9 for error, bound in pairs]
    return sum(not ratio <= 1 for ratio in ratios), max(ratios)


@quick(
    Row("mission.closed_forms", "|K phi - M w^2 phi| of Nastar's modes", "", 1e-14, "lower", 3e-15),
    Row("mission.forced", "eq. 3 forced, up to 1e8 times critical", goal=1e-14, tolerance=1e-15),
)
def closed_forms(seed: int) -> tuple[float, float]:
    shapes = (mm.OPEN_CURVE, mm.CLOSED_CURVE, mm.PLANE, mm.CYLINDER, mm.TORUS)
    lattices = (mm.Lattice(topology, (40, 100)[: len(topology.ends)]) for topology in shapes)
    return max(map(largest_residual, lattices)), forced_error(np.random.default_rng([seed, 0]))


quick(Row("mission.rest_point", "track from where the data let eq. 3 rest", "mm", goal=1e-5))(
    apart_at_rest
)


@timed(Row("mission.animation", "time, a million nodes over a thousand", goal=1.5, tolerance=0.15))
def animation(seed: int) -> float:
    forces = np.random.default_rng([seed, 2]).standard_normal((300, 7, 3))

    def animate(lattice: mm.Lattice) -> None:
        w = lattice.angular_frequencies(lattice.lowest_modes(7))
        step = exact_step(Oscillators(w, 0.1), 0.04)
        for _ in driven_states(step, list(forces), State(0 * forces[0], 0 * forces[0])):
            pass

    lattices = [mm.Lattice(mm.CYLINDER, (n, n)) for n in (32, 1000)]
    few, many = medians({str(each.shape): partial(animate, each) for each in lattices}, 9)
    return many / few


@quick(
    Row("mission.compression.3", f"{OF_VERTICES} 3 amplitudes", "", 4000, "higher", 0),
    Row("mission.compression.21", f"{OF_VERTICES} 21 amplitudes", "", 571, "higher", 0),
    Row("mission.compression.51", f"{OF_VERTICES} 51 amplitudes", "", 235, "higher", 0),
)
def compression(_: int) -> tuple[float, ...]:
    beat = mm.simulate_ventricle(grid=(40, 100), acquisition=mm.Acquisition(n_frames=2))
    signature = mm.modal_signature(beat, mm.SignatureParameters(modes=18))
    return tuple(first_modes(signature, n // 3).compression for n in (3, 21, 51))


@quick(*rows(COUNTS, "mission.left.{}", "RMS that {} modes leave, simulated", "mm"))
def left(seed: int) -> tuple[float, ...]:
    """Mean of five hearts of 1,000 vertices."""
    hearts = [individual(np.random.default_rng([seed, k]), n_vertices=1000) for k in range(5)]
    asked = [mm.SignatureParameters(modes=n) for n in COUNTS]
    errors = [[mm.modal_signature(heart, each).rms_error for each in asked] for heart in hearts]
    return tuple(np.mean(errors, axis=0).tolist())


@timed(*rows(COUNTS, "mission.time.{}", "signature, {} modes, 25 x 4,000 vertices over NumPy work"))
def times(seed: int) -> tuple[float, ...]:
    beat = individual(np.random.default_rng([seed, 3]), n_vertices=4000)
    asked = (mm.SignatureParameters(modes=n) for n in COUNTS)
    calls = {str(each.modes): partial(mm.modal_signature, beat, each) for each in asked}
    return tuple(beside_numpy(calls).values())
