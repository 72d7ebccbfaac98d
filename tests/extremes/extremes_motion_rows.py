"""Numerical extremes of projecting motion on lattices, each with the error that is reached.

Rows as in the extremes of the basis. Lengths are in mm.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes import ModeSet, lowest_modes
from modalmotion.modes.lattice import Lattice, project, project_all, superpose, superpose_all
from modalmotion.modes.topologies import CUP, CYLINDER, SPHERE, TORUS, lattice_coordinates

Row = tuple[str, str, Callable[[], float], float, Callable[[], float] | None]

EPS: Final = float(np.finfo(np.float64).eps)
SIGMA: Final = 0.5


def beat(lattice: Lattice, start: float = 0.0, sense: float = 1.0) -> NDArray[np.float64]:
    """Displace a ventricle 80 mm long and 50 mm wide as in a beat: 5 mm in the mean.

    Not symmetric about its axis, so that no pair of modes has its angle at rest.

    Parameters
    ----------
    lattice : Lattice
    start : float, turns
        Where the angle starts.
    sense : float
        +1, or -1 for the angle counted the other way.

    Returns
    -------
    (3 frames, nodes, 3) float64, mm
    """
    s, turns = lattice_coordinates(lattice.topology, lattice.shape).T
    theta = 2 * np.pi * (sense * turns + start)
    radius, height = 25 * np.sin(0.5 * np.pi * (0.2 + 0.8 * s)), 80 * s
    rest = np.stack([radius * np.cos(theta), radius * np.sin(theta), height], axis=1)
    frames = []
    for t in (0.3, 0.7, 1.0):
        squeeze = 1 - 0.2 * t * (1 + 0.3 * np.cos(theta - 0.7) + 0.2 * np.sin(2 * theta) * s)
        twist = theta + 0.1 * t * np.cos(np.pi * s)
        moved = np.stack(
            [
                radius * squeeze * np.cos(twist),
                radius * squeeze * np.sin(twist),
                height - 4 * t * (1 - np.cos(np.pi * s)) + t * np.cos(theta + 0.4) * s,
            ],
            axis=1,
        )
        frames.append(moved - rest)
    return np.stack(frames)


def of_beat(shape: tuple[int, int], n_modes: int = 54) -> NDArray[np.float64]:
    lattice = Lattice(CYLINDER, shape)
    return project(lattice, lattice.lowest_modes(n_modes), beat(lattice))


def magnitudes(modes: ModeSet, amplitudes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root of a^2 + b^2 of every cosine and sine."""
    sine = np.flatnonzero(modes.is_sine)
    return np.hypot(amplitudes[:, sine - 1], amplitudes[:, sine])


def pairs_of(start: float, sense: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Magnitudes of the pairs of a beat, and the amplitudes themselves."""
    lattice = Lattice(CYLINDER, (40, 100))
    modes = lattice.lowest_modes(54)
    amplitudes = project(lattice, modes, beat(lattice, start, sense))
    return magnitudes(modes, amplitudes), amplitudes


def change(start: float, sense: float, of: int) -> float:
    return float(np.abs(pairs_of(start, sense)[of] - pairs_of(0.0, 1.0)[of]).max())


def resolution_error(shape: tuple[int, int]) -> float:
    return float(np.abs(of_beat(shape, 9) - of_beat((128, 256), 9)).max())


def eigenvalue_order_error() -> float:
    """Compare 40 x 100 with 64 x 100 by rank of the lattice's own frequency."""
    ranked = []
    for shape in ((40, 100), (64, 100)):
        lattice = Lattice(CYLINDER, shape)
        modes = lattice.lowest_modes(54)
        order = np.argsort(lattice.angular_frequencies(modes), kind="stable")[:9]
        ranked.append(of_beat(shape)[:, order])
    return float(np.abs(ranked[0] - ranked[1]).max())


def checkerboard_error() -> float:
    """Largest stray amplitude of checkerboards of 1 mm, or what the one mode misses."""
    worst = 0.0
    for topology in (TORUS, SPHERE):
        # On a sphere p' = N' / 2 must be odd for the sine that alternates.
        lattice = Lattice(topology, (16, 10))
        board = (-1.0) ** np.add.outer(np.arange(16), np.arange(10))
        a = np.sort(np.abs(project_all(lattice, board.reshape(1, -1, 1)).ravel()))
        worst = max(worst, a[-2], abs(a[-1] - 1))
    return float(worst)


def reconstruction_error() -> float:
    worst = 0.0
    for topology in (CYLINDER, CUP, SPHERE, TORUS):
        lattice = Lattice(topology, (40, 100))
        u = beat(lattice)
        worst = max(worst, np.abs(superpose_all(lattice, project_all(lattice, u)) - u).max())
    return float(worst / np.abs(u).max())


def parseval_error() -> float:
    lattice = Lattice(CUP, (40, 100))
    u = beat(lattice)
    total = (u**2).mean(axis=1)
    return float(np.abs((project_all(lattice, u) ** 2).sum(axis=1) / total - 1).max())


def small_residual_error(subtract: bool) -> float:
    """Relative error of a mean-square residual 1e20 times smaller than the motion."""
    lattice, modes = Lattice(CUP, (40, 100)), lowest_modes(CUP, 60)
    amplitudes = np.zeros((1, 60, 1))
    amplitudes[0, :54, 0], amplitudes[0, 54:, 0] = 1.0, 1e-10
    u = superpose(lattice, modes, amplitudes)
    every = project_all(lattice, u)
    dropped = (every[:, 54:] ** 2).sum()
    found = (u**2).mean() - (every[:, :54] ** 2).sum() if subtract else dropped
    return float(abs(found / 6e-20 - 1))


ROWS: Final[list[Row]] = [
    (
        "start angle of the circumferential parameter shifted by 0.17 turns",
        "magnitudes of pairs unchanged, mm (naive: the amplitudes themselves)",
        lambda: change(0.17, 1.0, 0),
        1e-13,
        lambda: change(0.17, 1.0, 1),
    ),
    (
        "reversed orientation",
        "magnitudes of pairs unchanged, mm (naive: the amplitudes themselves)",
        lambda: change(0.0, -1.0, 0),
        1e-13,
        lambda: change(0.0, -1.0, 1),
    ),
    (
        "mode-set order vs resolution: 8 x 16 against 128 x 256",
        "9 amplitudes by label agree, mm (naive: by eigenvalue, 40 x 100 against 64 x 100)",
        lambda: resolution_error((8, 16)),
        0.04,
        eigenvalue_order_error,
    ),
    (
        "mode-set order vs resolution: 32 x 64 against 128 x 256",
        "9 amplitudes by label agree, mm",
        lambda: resolution_error((32, 64)),
        0.0012,
        None,
    ),
    (
        "mode-set order vs resolution: 64 x 100 against 128 x 256",
        "9 amplitudes by label agree, mm",
        lambda: resolution_error((64, 100)),
        0.0003,
        None,
    ),
    (
        "near-Nyquist content: a checkerboard",
        "lands in exactly one mode",
        checkerboard_error,
        4 * EPS,
        None,
    ),
    ("all-modes reconstruction", "exact, relative", reconstruction_error, 1e-13, None),
    ("Parseval", "sum a^2 is the mean square displacement, relative", parseval_error, 1e-13, None),
    (
        "Parseval: residual 1e-10 of the motion",
        "sum of the dropped modes' squares, relative (naive: total minus kept)",
        lambda: small_residual_error(subtract=False),
        1e-5,
        lambda: small_residual_error(subtract=True),
    ),
]
