"""Error and time of closed-form modes against the size of the lattice."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import matplotlib as mpl
import mpmath as mp
import numpy as np
from measure import side_by_side
from sparse_lattices import lowest_eigenpairs, stiffness_matrix

from modalmotion.modes import ModeLabel, ModeSet
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CUP, CYLINDER, OPEN_CURVE
from modalmotion.modes.transform import project

DENSE_SIZES = (2, 3, 4, 6, 8, 12, 16, 22, 30, 40)
TIMED_SIZES = (10, 20, 40, 70, 100, 200, 400)
HUGE_SIZES = tuple(10**k for k in range(1, 17))
Series = tuple[list[float], list[float]]


def draw(path: Path) -> None:
    """Measure and draw."""
    mpl.use("agg")
    import matplotlib.pyplot as plt

    figure, (error, time) = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
    error.loglog(*dense_errors(), "o-", label="all eigenvalues of a cup, against dense eigh")
    exact, naive = chain_errors()
    error.loglog(*exact, "s-", label=r"$4\,\sin^2(\pi/2N)$ of a chain, against 60 digits")
    error.loglog(*naive, "x--", color="0.5", label=r"the same as $2 - 2\,\cos(\pi/N)$")
    error.loglog(*cosine_errors(), "^-", label="shapes of a chain at p = N - 1, against 60 digits")
    error.axhline(np.finfo(float).eps, color="0.7", lw=0.8)
    error.text(1.2, 1.1e-16, "eps", color="0.4", va="top", fontsize=8)
    error.set(xlabel="nodes", ylabel="relative error", ylim=(2e-17, 10), title="Error")
    error.legend(fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.36))
    for name, series in times().items():
        time.loglog(*series, "o-", label=name)
    time.set(xlabel="nodes of a cylinder N x N", ylabel="seconds", title="Time, seven modes")
    time.legend(fontsize=8, loc="upper left")
    time.set_ylim(top=3e2)
    for axes in (error, time):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def dense_errors() -> Series:
    nodes, errors = [], []
    for n in DENSE_SIZES:
        lattice = Lattice(CUP, (n, 2 * (n // 2)))
        dense = np.linalg.eigvalsh(stiffness_matrix(lattice).toarray())
        ours = np.sort(lattice.angular_frequencies(lattice.all_modes()) ** 2)
        nodes.append(float(lattice.n_nodes))
        errors.append(max(1e-17, float(np.abs(ours - dense).max() / dense.max())))
    return nodes, errors


def chain_errors() -> tuple[Series, Series]:
    ours, naive = [], []
    for n in HUGE_SIZES:
        lattice = Lattice(OPEN_CURVE, (n,))
        w = float(lattice.angular_frequencies(lattice.lowest_modes(2))[1])
        with mp.workdps(60):
            right = 4 * mp.sin(mp.pi / (2 * n)) ** 2
            ours.append(max(3e-17, float(abs(mp.mpf(w) ** 2 / right - 1))))
            straight = mp.mpf(float(2 - 2 * np.cos(np.pi / n)))
            naive.append(float(abs(straight / right - 1)))
    sizes = [float(n) for n in HUGE_SIZES]
    return (sizes, ours), (sizes, naive)


def cosine_errors() -> Series:
    errors = []
    for n in HUGE_SIZES:
        modes = ModeSet.of(OPEN_CURVE, [ModeLabel((n - 1,), "cos")])
        nodes = [i * (n - 1) // 16 for i in range(17)]
        found = Lattice(OPEN_CURVE, (n,)).shapes(modes, nodes=nodes)[:, 0]
        with mp.workdps(60):
            worst = max(
                abs(mp.mpf(float(v)) - mp.sqrt(2) * mp.cos((n - 1) * mp.pi * (2 * i + 1) / (2 * n)))
                for i, v in zip(nodes, found, strict=True)
            )
        errors.append(max(3e-17, float(worst)))
    return [float(n) for n in HUGE_SIZES], errors


def times() -> dict[str, Series]:
    series: dict[str, Series] = {}
    for n in TIMED_SIZES:
        lattice = Lattice(CYLINDER, (n, n))
        modes, matrix = lattice.lowest_modes(7), stiffness_matrix(lattice)
        u = np.random.default_rng(0).standard_normal((25, n * n, 3))
        measured = side_by_side(
            {
                "shift-invert eigsh": partial(lowest_eigenpairs, matrix, 7),
                "25 frames projected": partial(project, lattice, modes, u),
                "shapes at every node": partial(lattice.shapes, modes),
                "separable factors": partial(lattice.factors, modes),
            },
            n_samples=3,
        )
        for name, seconds in measured.items():
            nodes, found = series.setdefault(name, ([], []))
            nodes.append(float(n * n))
            found.append(seconds.best)
    return series
