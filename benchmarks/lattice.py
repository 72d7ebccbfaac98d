"""Speed of closed-form modes and of the transforms on lattices."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import lattice_plot
import numpy as np
from measure import Table, in_words, side_by_side
from numpy.typing import NDArray
from sparse_lattices import lowest_eigenpairs, stiffness_matrix

from modalmotion.modes import ModeSet, order
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CUP, CYLINDER, TORUS
from modalmotion.modes.transform import (
    project,
    project_all,
    project_with,
    superpose,
    superpose_with,
)

FloatArray = NDArray[np.float64]

N_MODES = 7
# Size, bound of all shapes at all nodes, bound of their factors: times faster than eigsh.
AGAINST_EIGSH = ((100, 800.0, 5_000.0), (400, 2_000.0, 100_000.0))


def run(folder: Path) -> list[Table]:
    """Measure everything and draw the plot into a folder."""
    tables = [against_eigsh(), transforms(), animation(), streaming()]
    lattice_plot.draw(folder / "lattice.png")
    return tables


def against_eigsh() -> Table:
    table = Table(
        "Seven modes of a lattice, against shift-invert eigsh of its assembled matrix.\n"
        "Ours include every evaluation, from integers. Outside the times, once: the labels chosen\n"
        "and arranged (a line of its own); the matrix assembled. Fastest of runs side by side.",
        ("", "eigsh", "ours", "times faster"),
    )
    for topology in (CYLINDER, CUP, TORUS):
        for n, bound_of_shapes, bound_of_factors in AGAINST_EIGSH:
            lattice = Lattice(topology, (n, n))
            modes, matrix = lattice.lowest_modes(N_MODES), stiffness_matrix(lattice)
            out = np.empty((lattice.n_nodes, N_MODES), order="F")
            times = side_by_side(
                {
                    "eigsh": partial(lowest_eigenpairs, matrix, N_MODES),
                    "shapes": partial(lattice.shapes, modes, out=out),
                    "new": partial(lattice.shapes, modes),
                    "factors": partial(lattice.factors, modes),
                    "labels": partial(chosen, lattice),
                },
                n_samples=5 if n <= 100 else 3,
            )
            eigenvalues, _ = lowest_eigenpairs(matrix, N_MODES)
            ours = np.sort(lattice.angular_frequencies(modes) ** 2)
            lowest = np.sort(lattice.angular_frequencies(lattice.lowest_modes(40)) ** 2)[:N_MODES]
            assert np.abs(eigenvalues - lowest).max() <= 1e-10 * max(1.0, ours.max())
            solver = times["eigsh"].best
            for what, name, bound in (
                ("shapes, into memory at hand", "shapes", bound_of_shapes),
                ("shapes, into new memory", "new", bound_of_shapes),
                ("separable factors", "factors", bound_of_factors),
            ):
                ratio = solver / times[name].best
                table.add_at_least(
                    ratio,
                    bound,
                    f"{topology} {n} x {n}, {what}",
                    in_words(solver),
                    in_words(times[name].best),
                    f"{ratio:,.0f}",
                )
            table.add(
                f"{topology} {n} x {n}, labels chosen and arranged once",
                "",
                in_words(times["labels"].best),
                "",
            )
    return table


def chosen(lattice: Lattice) -> ModeSet:
    """Select modes and arrange their labels, as is done once for a number of modes."""
    order._lowest_kept.cache_clear()
    modes = lattice.lowest_modes(N_MODES)
    _ = modes.separable.sums, modes.coefficients, modes.extents, modes.separable.waves
    return modes


def transforms() -> Table:
    table = Table(
        "25 frames x 4,000 nodes x 3 directions on 7 modes, against a float64 copy of the array.\n"
        "All checks are included; factors are kept from call to call. 'Evaluated anew': not.\n"
        "Fastest of runs side by side.",
        ("", "copy", "ours", "ratio", "of medians"),
    )
    rng = np.random.default_rng(0)
    u = rng.standard_normal((25, 4000, 3))
    for topology, shape in (
        (CYLINDER, (40, 100)),
        (CYLINDER, (100, 40)),
        (CUP, (40, 100)),
        (TORUS, (40, 100)),
    ):
        lattice = Lattice(topology, shape)
        modes = lattice.lowest_modes(N_MODES)
        a = project(lattice, modes, u)
        times = side_by_side(
            {
                "copy": u.copy,
                "project": partial(project, lattice, modes, u),
                "superpose": partial(superpose, lattice, modes, a),
                "project, evaluated anew": partial(project_anew, lattice, modes, u),
                "superpose, evaluated anew": partial(superpose_anew, lattice, modes, a),
            },
            n_samples=200,
        )
        for name in list(times)[1:]:
            ratio = times[name].best / times["copy"].best
            cells = (
                f"{topology} {shape[0]} x {shape[1]}, {name}",
                in_words(times["copy"].best),
                in_words(times[name].best),
                f"{ratio:.2f}",
                f"{times[name].median / times['copy'].median:.2f}",
            )
            if topology is CYLINDER and "anew" not in name:
                table.add_at_most(ratio, 3.0, *cells)
            else:
                table.add(*cells)
    return table


def project_anew(lattice: Lattice, modes: ModeSet, u: FloatArray) -> FloatArray:
    return project_with(lattice.factors(modes), u)


def superpose_anew(lattice: Lattice, modes: ModeSet, a: FloatArray) -> FloatArray:
    return superpose_with(lattice.factors(modes), a)


def animation() -> Table:
    table = Table(
        "Animation of 11,130 nodes by 21 amplitudes, one frame at a time.",
        ("", "frames", "a frame", "frames a second"),
    )
    lattice = Lattice(CYLINDER, (105, 106))
    modes = lattice.lowest_modes(N_MODES)
    shapes, factors = lattice.shapes(modes), lattice.factors(modes)
    frame = np.empty((1, lattice.n_nodes, 3))

    def multiply_shapes(amplitudes: FloatArray) -> None:
        for one in amplitudes:
            np.matmul(shapes, one, out=frame[0])

    def superpose_factors(amplitudes: FloatArray) -> None:
        for i in range(len(amplitudes)):
            superpose_with(factors, amplitudes[i : i + 1], out=frame)

    for name, play in (
        ("product with the shapes", multiply_shapes),
        ("superposition from the factors", superpose_factors),
    ):
        rates = []
        for n_frames in (30, 300, 3000):
            a = np.random.default_rng(0).standard_normal((n_frames, N_MODES, 3))
            seconds = side_by_side({"": partial(play, a)}, n_samples=15)[""].best / n_frames
            rates.append(1 / seconds)
            table.add(name, f"{n_frames:,}", in_words(seconds), f"{rates[-1]:,.0f}")
        spread = max(rates) / min(rates)
        table.add_at_most(spread, 1.5, f"{name}: flat", "", "", f"x {spread:.2f}")
    return table


def streaming() -> Table:
    table = Table(
        "A million nodes x 25 frames in float32, streamed, in a process of its own.",
        ("", "seconds", "MB above the input"),
    )
    for name, run_one in (
        ("7 modes", stream_few_modes),
        ("all modes, their labels too", stream_all_modes),
    ):
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
            seconds, megabytes = process.submit(run_one).result()
        table.add_at_most(megabytes, 200.0, name, f"{seconds:.2f}", f"{megabytes:.0f}")
    return table


def stream_few_modes() -> tuple[float, float]:
    lattice = Lattice(CYLINDER, (1000, 1000))
    modes = lattice.lowest_modes(N_MODES)
    frames = np.broadcast_to(np.ones((1, 10**6, 3), dtype=np.float32), (25, 10**6, 3))
    before, start = peak_megabytes(), time.perf_counter()
    project(lattice, modes, frames)
    return time.perf_counter() - start, peak_megabytes() - before


def stream_all_modes() -> tuple[float, float]:
    lattice = Lattice(CYLINDER, (1000, 1000))
    frame, out = np.ones((1, 10**6, 3), dtype=np.float32), np.ones((1, 10**6, 3))
    before, start = peak_megabytes(), time.perf_counter()
    for _ in range(25):
        project_all(lattice, frame, out=out)
    return time.perf_counter() - start, peak_megabytes() - before


def peak_megabytes() -> float:
    """Most memory this process has held, where the system says it; else not a number."""
    status = Path("/proc/self/status")
    if not status.exists():
        return np.nan
    line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
    return int(line.split()[1]) * 1024 / 1e6
