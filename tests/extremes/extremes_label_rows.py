"""Numerical extremes of labels and counts of modes, each with the error that is reached.

A row is the extreme, the right answer, what computes the error reached, its bound, and what
computes the error of the straightforward formula, where there is one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from dense_lattices import SURFACES, stiffness_matrix
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.modes import ModeLabel, ModeSet, all_modes, lowest_modes, whole_count
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import (
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    TORUS,
    Topology,
)

Row = tuple[str, str, Callable[[], float], float, Callable[[], float] | None]

EPS: Final = float(np.finfo(np.float64).eps)
DIGITS: Final = 60


def one_node_error() -> float:
    worst = 0.0
    for topology, shape in (
        (OPEN_CURVE, (1,)),
        (CLOSED_CURVE, (1,)),
        (PLANE, (1, 1)),
        (CUP, (1, 2)),
    ):
        lattice = Lattice(topology, shape)
        modes = lattice.lowest_modes(1)
        worst = max(worst, np.abs(lattice.shapes(modes) - 1).max())
        worst = max(worst, lattice.angular_frequencies(modes).max())
    return float(worst)


def ring_of_two_error() -> float:
    lattice = Lattice(CLOSED_CURVE, (2,), stiffness=3.0, mass=0.5)
    found = np.sort(lattice.angular_frequencies(lattice.all_modes()) ** 2)
    return float(np.abs(found - np.linalg.eigvalsh(stiffness_matrix(lattice))).max() / 24.0)


def single_spring_error() -> float:
    """Join the two nodes by one spring."""
    matrix = 3.0 / 0.5 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return float(np.abs(np.linalg.eigvalsh(matrix) - [0.0, 24.0]).max() / 24.0)


def alternating_error() -> float:
    """Of p = N / 2 from +1, -1, ...; infinite if its sine is among the modes."""
    worst = 0.0
    for n in range(2, 41, 2):
        lattice = Lattice(CLOSED_CURVE, (n,))
        modes = lattice.all_modes()
        if ModeLabel((n // 2,), "sin") in modes.labels:
            return np.inf
        found = lattice.shapes(modes)[:, modes.labels.index(ModeLabel((n // 2,), "cos"))]
        worst = max(worst, np.abs(found - (-1.0) ** np.arange(1, n + 1)).max())
    return float(worst)


def undropped_sine_error() -> float:
    """Orthonormality of a basis that keeps the sine of p = N / 2 and scales by sqrt 2."""
    n, x = 8, np.arange(1, 9) / 8
    waves = [wave(2 * np.pi * p * x) for p in range(1, 5) for wave in (np.cos, np.sin)]
    Phi = np.stack([np.ones(n), *(np.sqrt(2) * wave for wave in waves)], axis=1)
    return float(np.abs(Phi.T @ Phi / n - np.eye(Phi.shape[1])).max())


def torus_count_error() -> float:
    """Largest share of missing or surplus modes, or of wrong self-conjugate points."""
    worst = 0.0
    for n in range(1, 10):
        for m in range(1, 10):
            modes = all_modes(TORUS, (n, m))
            n_alone = n * m - 2 * int(modes.is_sine.sum())
            found = (len(modes) - n * m, len(set(modes.labels)) - n * m)
            worst = max(worst, *map(abs, found), abs(n_alone - (2 - n % 2) * (2 - m % 2)))
    return float(worst)


def quarter_torus_count_error() -> float:
    """Take cos and sin(a + b) of p, p' >= 0 only, without their (p, -p')."""
    n = 8
    count = sum(2 - (2 * p % n == 0 and 2 * q % n == 0) for p in range(5) for q in range(5))
    return abs(count - n * n) / (n * n)


def order_changes(key: Callable[[Lattice, ModeSet], NDArray[np.floating]] | None) -> float:
    """Places of the order that change with the rounding of equal frequencies."""
    changes = 0
    for topology in (PLANE, TORUS):
        for n in (8, 12, 16):
            lattice = Lattice(topology, (n, n))
            modes = lattice.all_modes()
            orders = []
            for scale in (1.0, 3.0, 7.0):
                scaled = Lattice(topology, (n, n), stiffness=scale)
                if key is None:
                    orders.append(np.array([hash(label) for label in scaled.all_modes().labels]))
                else:
                    orders.append(np.argsort(key(scaled, modes), kind="stable"))
            changes += sum(int((order != orders[0]).sum()) for order in orders)
    return float(changes)


def floating_eigenvalues(lattice: Lattice, modes: ModeSet) -> NDArray[np.floating]:
    w: NDArray[np.float64] = lattice.angular_frequencies(modes) ** 2
    return w


def split_pairs(round_up: bool) -> float:
    """Counts from 1 to 120 whose set of modes holds a cosine without its sine."""
    count = 0
    for topology in (*SURFACES, CLOSED_CURVE):
        for n in range(1, 121):
            kept = whole_count(topology, n) if round_up else n
            more = lowest_modes(topology, kept + 1)
            count += bool(more.is_sine[-1])
    return float(count)


def accepted_beyond_nyquist() -> float:
    """Labels beyond what the nodes resolve that are evaluated all the same."""
    cases: list[tuple[Topology, tuple[int, ...], tuple[int, ...]]] = [
        (OPEN_CURVE, (6,), (6,)),
        (CLOSED_CURVE, (6,), (4,)),
        (CLOSED_CURVE, (7,), (4,)),
        (CYLINDER, (4, 6), (0, 4)),
        (CYLINDER, (4, 6), (4, 0)),
        (CUP, (4, 6), (1, 5)),
        (TORUS, (4, 6), (2, -3)),
    ]
    accepted = 0
    for topology, shape, p in cases:
        try:
            Lattice(topology, shape).shapes(ModeSet.of(topology, [ModeLabel(p, "cos")]))
        except ParameterError:
            continue
        accepted += 1
    return float(accepted)


ROWS: Final[list[Row]] = [
    ("N = 1 (one node)", "one constant mode, w = 0, open and closed", one_node_error, 0.0, None),
    (
        "N = 2 closed",
        "0 and 4 K / M: two springs join the two nodes (naive: one spring)",
        ring_of_two_error,
        EPS,
        single_spring_error,
    ),
    (
        "p = N / 2, N even, closed",
        "+1, -1, ... with mean square 1; its sine is no mode (naive: kept)",
        alternating_error,
        0.0,
        undropped_sine_error,
    ),
    (
        "torus self-conjugate points",
        "4, 2 or 1 of them, N N' modes in all (naive: p, p' >= 0 only, share lost)",
        torus_count_error,
        0.0,
        quarter_torus_count_error,
    ),
    (
        "accidental degeneracy (N = N' plane, torus)",
        "places of the order that depend on rounding: none (naive: sorted by eigenvalue)",
        lambda: order_changes(None),
        0.0,
        lambda: order_changes(floating_eigenvalues),
    ),
    (
        "truncation that would split a cos/sin pair",
        "counts from 1 to 120 that split one: none (naive: taken literally)",
        lambda: split_pairs(round_up=True),
        0.0,
        lambda: split_pairs(round_up=False),
    ),
    (
        "near-Nyquist content: labels beyond Nyquist that are accepted",
        "none: they would alias into low modes",
        accepted_beyond_nyquist,
        0.0,
        None,
    ),
]
