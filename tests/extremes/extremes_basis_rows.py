"""Numerical extremes of the basis and its eigenvalues, each with the error that is reached.

A row is the extreme, the right answer, what computes the error reached, its bound, and what
computes the error of the straightforward formula, where there is one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Final

import mpmath as mp
import numpy as np
from dense_lattices import MIDDLE_LATTICES, SMALL_LATTICES, stiffness_matrix
from numpy.typing import NDArray

from modalmotion.modes import ModeLabel, ModeSet
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import OPEN_CURVE

Row = tuple[str, str, Callable[[], float], float, Callable[[], float] | None]

EPS: Final = float(np.finfo(np.float64).eps)
DIGITS: Final = 60


@cache
def dense_errors() -> tuple[float, float, float]:
    """Worst errors of eigenvalues, residual and orthonormality against dense matrices."""
    worst = np.zeros(3)
    for lattice in (*SMALL_LATTICES, *MIDDLE_LATTICES):
        matrix, modes = stiffness_matrix(lattice), lattice.all_modes()
        eigenvalues = np.linalg.eigvalsh(matrix)
        largest = max(eigenvalues[-1], min(lattice.stiffnesses) / lattice.mass)
        Phi, squared = lattice.shapes(modes), lattice.angular_frequencies(modes) ** 2
        gram = Phi.T @ Phi / lattice.n_nodes
        errors = (
            np.abs(np.sort(squared) - eigenvalues).max() / largest,
            np.abs(matrix @ Phi - Phi * squared).max() / largest,
            np.abs(gram - np.eye(lattice.n_nodes)).max(),
        )
        worst = np.maximum(worst, errors)
    return float(worst[0]), float(worst[1]), float(worst[2])


def first_eigenvalue(n: int) -> mp.mpf:
    """4 sin^2(pi / 2N), the smallest of an open chain that is not zero."""
    with mp.workdps(DIGITS):
        return 4 * mp.sin(mp.pi / (2 * n)) ** 2


def small_eigenvalue_error() -> float:
    worst = 0.0
    for n in (10**4, 10**8, 10**12, 10**16):
        lattice = Lattice(OPEN_CURVE, (n,))
        w = lattice.angular_frequencies(lattice.lowest_modes(2))[1]
        with mp.workdps(DIGITS):
            worst = max(worst, float(abs(mp.mpf(float(w)) ** 2 / first_eigenvalue(n) - 1)))
    return worst


def two_minus_two_cosines(n: int) -> float:
    with mp.workdps(DIGITS):
        return float(abs(mp.mpf(2 - 2 * np.cos(np.pi / n)) / first_eigenvalue(n) - 1))


def some_nodes(n: int) -> list[int]:
    """Nodes spread over a chain, zero-based, the last ones among them."""
    return [0, 1, *(i * n // 101 for i in range(1, 101)), n - 2, n - 1]


def exact_cosines(n: int, p: int) -> NDArray[np.float64]:
    """cos(p pi (2 node + 1) / 2N) to the last place."""
    with mp.workdps(DIGITS):
        return np.array(
            [float(mp.cos(p * mp.pi * (2 * node + 1) / (2 * n))) for node in some_nodes(n)]
        )


def cosine_error(sizes: tuple[int, ...]) -> float:
    """Worst absolute error of the cosines of high wavenumbers, in units of their amplitude."""
    worst = 0.0
    for n in sizes:
        for p in (n - 1, n - 2, n // 2 + 1, n // 3):
            modes = ModeSet.of(OPEN_CURVE, [ModeLabel((p,), "cos")])
            found = Lattice(OPEN_CURVE, (n,)).shapes(modes, nodes=some_nodes(n))[:, 0]
            worst = max(worst, np.abs(found / np.sqrt(2.0) - exact_cosines(n, p)).max())
    return float(worst)


def unreduced_cosine_error(n: int, dtype: type[np.floating]) -> float:
    worst = 0.0
    for p in (n - 1, n - 2, n // 2 + 1, n // 3):
        odd = 2 * np.array(some_nodes(n), dtype=dtype) + 1
        naive = np.cos(dtype(p) * odd * (dtype(np.pi) / dtype(2 * n)))
        worst = max(worst, float(np.abs(naive.astype(np.float64) - exact_cosines(n, p)).max()))
    return worst


def overflowing_cosine_error(n: int) -> float:
    """Reduce p(2n - 1) modulo 4N in int64 without looking at its size."""
    p = n - 1
    odd = 2 * np.array(some_nodes(n), dtype=np.int64) + 1
    with np.errstate(over="ignore"):
        k = (np.int64(p) * odd) % np.int64(4 * n)
    return float(np.abs(np.cos(np.pi * k / (2 * n)) - exact_cosines(n, p)).max())


ROWS: Final[list[Row]] = [
    (
        "any N, N', all topologies, small sizes: eigenvalues",
        "those of the dense matrix, relative to the largest",
        lambda: dense_errors()[0],
        2e-14,
        None,
    ),
    (
        "any N, N', all topologies, small sizes: residual",
        "K Phi = M Phi Omega^2, relative to the largest eigenvalue",
        lambda: dense_errors()[1],
        2e-15,
        None,
    ),
    (
        "any N, N', all topologies, small sizes: orthonormality",
        "Phi'Phi is the number of nodes times the identity, relative",
        lambda: dense_errors()[2],
        4e-15,
        None,
    ),
    (
        "small eigenvalue, huge N: 1e4, 1e8, 1e12, 1e16",
        "4 sin^2(pi / 2N), relative (the naive 2 - 2 cos at N = 1e8)",
        small_eigenvalue_error,
        2 * EPS,
        lambda: two_minus_two_cosines(10**8),
    ),
    (
        "high p, large N: cos(p pi (2n - 1) / 2N) at N = 1e6, 1e7",
        "to the last place (naive: float64 without reduction)",
        lambda: cosine_error((10**6, 10**7)),
        2 * EPS,
        lambda: unreduced_cosine_error(10**7, np.float64),
    ),
    (
        "high p, large N: the same in float32",
        "to the last place of float64 (naive: float32)",
        lambda: cosine_error((10**6, 10**7)),
        2 * EPS,
        lambda: unreduced_cosine_error(10**7, np.float32),
    ),
    (
        "int overflow in p (2n - 1), N = 3e9, 1e12, 1e16",
        "exact integers of any length (naive: int64 at N = 1e12)",
        lambda: cosine_error((3 * 10**9, 10**12, 10**16)),
        2 * EPS,
        lambda: overflowing_cosine_error(10**12),
    ),
]
