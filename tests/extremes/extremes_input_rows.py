"""Numerical extremes of displacements that come in, each with the error that is reached.

Rows as in the extremes of the basis. Lengths are in mm.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Final

import numpy as np
from extremes_motion_rows import beat

from modalmotion.errors import ModeCountError, NonFiniteError
from modalmotion.modes import lowest_modes
from modalmotion.modes.lattice import Lattice, project, superpose
from modalmotion.modes.topologies import CUP, CYLINDER, SPHERE

Row = tuple[str, str, Callable[[], float], float, Callable[[], float] | None]

EPS: Final = float(np.finfo(np.float64).eps)
SIGMA: Final = 0.5


def offset_error(offset: float, dtype: type[np.floating]) -> float:
    """Change of the amplitudes, mm, by an offset of the positions they are measured from."""
    lattice = Lattice(CUP, (40, 100))
    modes, u = lattice.lowest_modes(54), beat(lattice)
    rest = np.full((1, lattice.n_nodes, 3), offset)
    moved = (u + rest).astype(dtype) - rest.astype(dtype)
    return float(np.abs(project(lattice, modes, moved) - project(lattice, modes, u)).max())


def scale_error(scales: tuple[float, ...]) -> float:
    lattice = Lattice(CUP, (40, 100))
    modes, u = lattice.lowest_modes(54), beat(lattice)
    a, worst = project(lattice, modes, u), 0.0
    around = superpose(lattice, modes, a)
    for scale in scales:
        scaled = project(lattice, modes, u * scale) / scale
        back = superpose(lattice, modes, a * scale) / scale
        worst = max(worst, np.abs(scaled - a).max(), np.abs(back - around).max())
    return float(worst / np.abs(u).max())


def accepted_counts() -> float:
    """Counts beyond the number of nodes that are not refused."""
    accepted = 0
    for n_modes in (13, 14, 1000):
        try:
            Lattice(CUP, (3, 4)).lowest_modes(n_modes)
        except ModeCountError:
            continue
        accepted += 1
    return float(accepted)


def noise_error() -> float:
    """Relative deviation of the amplitudes' noise from sigma / sqrt(nodes)."""
    lattice, rng = Lattice(CUP, (64, 100)), np.random.default_rng(7)
    noise = SIGMA * rng.standard_normal((40, 6400, 3))
    a = project(lattice, lattice.lowest_modes(54), noise)
    return float(abs(a.std() / (SIGMA / np.sqrt(6400)) - 1))


def translation_error() -> float:
    lattice, t = Lattice(CUP, (40, 100)), np.array([1.0, -20.0, 300.0])
    u = np.broadcast_to(t, (1, 4000, 3))
    a = project(lattice, lattice.lowest_modes(54), u)
    left = u - superpose(lattice, lattice.lowest_modes(54), a)
    a[0, 0] -= t
    return float(max(np.abs(a).max(), np.abs(left).max()) / 300.0)


def static_error() -> float:
    lattice = Lattice(CUP, (40, 100))
    rest = beat(lattice)[:1] + 1e6
    still = np.repeat(rest, 5, axis=0) - rest
    worst = 0.0
    for u in (still, still[:1], still[:2]):
        worst = max(worst, np.abs(project(lattice, lattice.lowest_modes(54), u)).max())
    return float(worst)


def unnamed_values() -> float:
    """NaN and infinities that are accepted, or named by another frame or node."""
    lattice, missed = Lattice(CUP, (4, 6)), 0
    for value in (np.nan, np.inf, -np.inf):
        for node in range(24):
            u = np.zeros((3, 24, 3))
            u[1, node, 2] = value
            try:
                project(lattice, lattice.lowest_modes(7), u)
            except NonFiniteError as error:
                missed += (error.frame, error.vertex) != (1, node)
                continue
            missed += 1
    return float(missed)


def pole_error() -> float:
    """Largest value at a pole of a mode that turns about it."""
    worst = 0.0
    for topology, poles in ((CUP, (0.0,)), (SPHERE, (0.0, 1.0))):
        modes = lowest_modes(topology, 200)
        turning = modes.take(np.flatnonzero(modes.wavenumbers[:, 1]))
        for s in poles:
            at = np.column_stack([np.full(9, s), np.linspace(0, 1, 9)])
            worst = max(worst, np.abs(turning.shapes_at(at)).max())
    return float(worst)


def cylinder_at_pole_error() -> float:
    """Spread over the circle of the cylinder's modes where that circle is one point."""
    modes = lowest_modes(CYLINDER, 54)
    at = np.column_stack([np.zeros(9), np.linspace(0, 1, 9)])
    return float(np.ptp(modes.shapes_at(at), axis=0).max())


def streaming_megabytes() -> float:
    """Most memory above the input while 25 frames of a million nodes are projected."""
    lattice = Lattice(CYLINDER, (1000, 1000))
    modes = lattice.lowest_modes(7)
    u = np.broadcast_to(np.ones((1, 10**6, 3), dtype=np.float32), (25, 10**6, 3))
    tracemalloc.start()
    try:
        project(lattice, modes, u)
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


ROWS: Final[list[Row]] = [
    (
        "coordinates offset by 1e6 mm",
        "reference subtracted in float64, mm (naive: stored in float32 first)",
        lambda: offset_error(1e6, np.float64),
        3e-12,
        lambda: offset_error(1e6, np.float32),
    ),
    (
        "coordinates offset by 1e9 mm",
        "reference subtracted in float64, mm (naive: stored in float32 first)",
        lambda: offset_error(1e9, np.float64),
        3e-9,
        lambda: offset_error(1e9, np.float32),
    ),
    (
        "unit change, scale 2^-40 ... 2^40",
        "amplitudes scale exactly",
        lambda: scale_error(tuple(2.0**k for k in range(-40, 41, 8))),
        0.0,
        None,
    ),
    (
        "unit change, scale 1e-12 ... 1e12",
        "amplitudes scale to the last places, relative",
        lambda: scale_error(tuple(10.0**k for k in range(-12, 13, 3))),
        8 * EPS,
        None,
    ),
    (
        "coordinates of 1e-200 and 1e200",
        "amplitudes scale to the last places, relative",
        lambda: scale_error((1e-200, 1e200)),
        8 * EPS,
        None,
    ),
    (
        "fewer nodes than modes: counts that are accepted",
        "none",
        accepted_counts,
        0.0,
        None,
    ),
    (
        "vertex noise sigma",
        "amplitude noise sigma / sqrt(nodes), relative deviation of 6,480 amplitudes",
        noise_error,
        0.03,
        None,
    ),
    (
        "pure translation",
        "only the (0, 0) triple is non-zero, residual 0, relative",
        translation_error,
        # A sum of 4,000 equal numbers, in the order of whichever product the machine has.
        16 * EPS,
        None,
    ),
    (
        "static sequence, single frame, two frames",
        "all amplitudes exactly 0",
        static_error,
        0.0,
        None,
    ),
    (
        "NaN/inf node: values that are not named by frame and node",
        "none",
        unnamed_values,
        0.0,
        None,
    ),
    (
        "pole (apex): azimuth undefined at r = 0",
        "modes with p' > 0 vanish there (naive: the cylinder's modes)",
        pole_error,
        0.0,
        cylinder_at_pole_error,
    ),
    (
        "1e6 nodes x 25 frames",
        "frames streamed: MB above the input (naive: a float64 copy)",
        streaming_megabytes,
        200.0,
        lambda: 25 * 3e6 * 8 / 1e6,
    ),
]
