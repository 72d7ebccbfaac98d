"""The trade of accuracy against time, memory and numbers: writes docs/tradeoff.md."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import tradeoff_figures
from measure import Table, in_words, side_by_side
from real_data import is_there, recording
from tradeoff_bases import BELTRAMI, CLOSED, PCA, ROOT, SPRINGS, Front, fronts, surfaces, ventricle
from tradeoff_report import Report, write
from tradeoff_sizes import N_MODES, ORDER, Cost, costs, of_modes, of_types

from modalmotion.choice.fitter import Fitter
from modalmotion.clinical import clinical_readouts
from modalmotion.fit.basis import make_basis
from modalmotion.formats import read_npz, write_npz
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import signature_to_hdf5
from modalmotion.template import choose_modes, make_template

DOCS = ROOT / "docs"
COUNTS = (4, 7, 18, 37, 61)
N_VENTRICLES = 20
MODE_COUNTS = (7, 18, 37, 100, 300)
OFFSETS = (0.0, 1e3, 1e4, 1e5, 1e6)

Fronts = dict[str, dict[str, Front]]


def run(_folder: Path) -> list[Table]:
    """Measure everything; write docs/tradeoff.md and its figures."""
    by_surface = {name: fronts(sequence) for name, sequence in surfaces().items()}
    by_size = costs()
    report = Report(
        ventricles=ventricles(),
        stages=stages(),
        bases=bases(by_surface),
        principal=principal(by_surface),
        sizes=sizes(by_size),
        modes=modes(),
        types=types(),
        offsets=offsets(),
        best=best(by_surface),
        fronts=by_surface,
        costs=by_size,
    )
    figures = DOCS / "figures"
    figures.mkdir(exist_ok=True)
    tradeoff_figures.draw_fronts(by_surface, figures / "tradeoff-fronts.png")
    tradeoff_figures.draw_surfaces(by_surface, figures / "tradeoff-surfaces.png")
    tradeoff_figures.draw_sizes(by_size, figures / "tradeoff-sizes.png")
    tradeoff_figures.draw_volume(ventricle(1200, seed=3), figures / "volume.png")
    write(report, DOCS / "tradeoff.md")
    return report.tables


def ventricles() -> Table:
    """Measure what ever more amplitudes leave of ventricles."""
    table = Table(
        f"{N_VENTRICLES} simulated ventricles (25 frames, 1,200 vertices), and a real one",
        (
            "amplitudes a frame",
            "RMS left, mm: median",
            "90 %",
            "real",
            "ejection fraction off by, points: median",
            "90 %",
            "real",
            "kB a beat",
            "compression a frame",
        ),
    )
    simulated = [ventricle(1200, seed) for seed in range(N_VENTRICLES)]
    real = None
    if is_there("tradeoff: a real ventricle", "heart/lv_endocardium"):
        real = recording("heart/lv_endocardium")
    for k in COUNTS:
        left, off = np.array([_left_and_off(sequence, k) for sequence in simulated]).T
        own = ("not at hand", "not at hand")
        if real is not None:
            values = _left_and_off(real, k)
            own = (f"{values[0]:.2f}", f"{values[1]:.2f}")
        table.add(
            f"{3 * k}",
            f"{np.median(left):.2f}",
            f"{np.quantile(left, 0.9):.2f}",
            own[0],
            f"{np.median(off):.2f}",
            f"{np.quantile(off, 0.9):.2f}",
            own[1],
            f"{4 * 3 * k * 25 / 1000:.1f}",
            f"{1200 / k:.0f}",
        )
    return table


def stages() -> Table:
    """Where the time of the usual request goes."""
    sequence = mesh_sequence(
        (made := ventricle(1500)).vertices.astype(np.float32), made.faces, unit="mm"
    )
    file = write_npz(sequence)
    template = make_template(sequence)
    chosen = choose_modes(template, N_MODES).modes
    basis = make_basis(template, chosen)
    signature = modal_signature(sequence)
    calls: dict[str, Callable[[], object]] = {
        "read the npz file, check every number": partial(read_npz, file),
        "natural coordinates (once for a mesh)": partial(make_template, sequence),
        "evaluate and factor 7 modes (once for a mesh)": partial(make_basis, template, chosen),
        "fit 25 frames, with rotations and errors": partial(
            Fitter.of(sequence, template).fit, basis
        ),
        "write the HDF5 result": partial(signature_to_hdf5, signature),
        "volume and ejection fraction, if asked for": partial(
            clinical_readouts, signature, sequence
        ),
    }
    times = side_by_side(calls, n_samples=15)
    table = Table("A beat of 25 frames and 1,500 vertices, fastest of 15 runs", ("stage", "time"))
    for name, taken in times.items():
        table.add(name, in_words(taken.best))
    return table


def bases(by_surface: Fronts) -> Table:
    """RMS of each basis with the same number of amplitudes."""
    table = Table(
        "RMS left, mm, with 21 / 54 / 111 amplitudes a frame",
        ("surface", CLOSED, SPRINGS, BELTRAMI),
    )
    for name, found in by_surface.items():
        cells = [
            " / ".join(f"{found[basis].at(a):.3f}" for a in (21, 54, 111))
            if basis in found
            else "none"
            for basis in (CLOSED, SPRINGS, BELTRAMI)
        ]
        table.add(name, *cells)
    return table


def principal(by_surface: Fronts) -> Table:
    """PCA beside the closed form, by the numbers that must be kept."""
    table = Table(
        "Numbers to keep beyond the reference mesh, until the RMS left is a share of the motion",
        (
            "surface",
            f"20 %: {CLOSED}",
            "PCA",
            f"10 %: {CLOSED}",
            "PCA",
            f"5 %: {CLOSED}",
            "PCA",
        ),
    )
    for name, found in by_surface.items():
        motion = found[CLOSED].motion
        cells: list[str] = []
        for share in (0.2, 0.1, 0.05):
            cells += [_numbers(found[basis], share * motion) for basis in (CLOSED, PCA)]
        table.add(name, *cells)
    return table


def sizes(by_size: dict[str, list[Cost]]) -> Table:
    """Seconds and memory against size."""
    table = Table(
        "Time, memory above the input, RMS left; 12 frames, 7 modes (PCA: components)",
        ("basis", *(f"{size.n_vertices:,} vertices" for size in by_size[ORDER[1]])),
    )
    for name in ORDER:
        table.add(name, *(_cost(cost) for cost in by_size[name]))
    return table


def modes() -> Table:
    """Cost of more modes."""
    table = Table(
        "Closed-form modes on 10,000 vertices, 12 frames",
        ("modes", "evaluate and factor", "fit", "memory above the input", "RMS left"),
    )
    for k, cost in of_modes(MODE_COUNTS).items():
        if cost.stopped:
            table.add(f"{k}", cost.stopped, "", "", "")
            continue
        table.add(
            f"{k}",
            in_words(cost.seconds["modes"]),
            in_words(cost.seconds["fit"]),
            f"{cost.megabytes:.0f} MB",
            f"{cost.rms:.3f} mm",
        )
    return table


def types() -> Table:
    """Cost of the input's type."""
    table = Table(
        "100,000 vertices, 12 frames, 21 amplitudes",
        ("input", "its size", "coordinates", "fit", "memory above the input", "RMS left"),
    )
    for name, cost in of_types().items():
        size = 12 * cost.n_vertices * 3 * np.dtype(name).itemsize / 1e6
        table.add(
            name,
            f"{size:.0f} MB",
            in_words(cost.seconds.get("coordinates", float("nan"))),
            in_words(cost.seconds.get("fit", float("nan"))),
            f"{cost.megabytes:.0f} MB",
            f"{cost.rms:.6f} mm",
        )
    return table


def offsets() -> Table:
    """Measure what float32 loses away from the origin."""
    table = Table(
        "Largest change of an amplitude, mm, by storing a ventricle away from the origin",
        ("distance from the origin, mm", "as float32", "as float64"),
    )
    made = ventricle(1500)
    exact = modal_signature(made).amplitudes
    for offset in OFFSETS:
        cells = []
        for kind in (np.float32, np.float64):
            moved = (made.vertices + offset).astype(kind)
            found = modal_signature(mesh_sequence(moved, made.faces, unit="mm")).amplitudes
            cells.append(f"{np.abs(found - exact).max():.1e}")
        table.add(f"{offset:,.0f}", *cells)
    return table


def best(by_surface: Fronts) -> dict[str, int]:
    """On how many surfaces each basis leaves least with 21 amplitudes."""
    wins = dict.fromkeys((CLOSED, SPRINGS, BELTRAMI), 0)
    for found in by_surface.values():
        if SPRINGS in found:
            wins[min(wins, key=lambda basis: found[basis].at(21))] += 1
    return wins


def _left_and_off(sequence: MeshSequence, n_modes: int) -> tuple[float, float]:
    signature = modal_signature(sequence, SignatureParameters(modes=n_modes))
    found = clinical_readouts(signature, sequence)
    off = (found.curve.share or 0.0) - (found.mesh_curve.share or 0.0)
    return signature.weighted_rms_error, abs(off)


def _numbers(front: Front, bound: float) -> str:
    enough = np.flatnonzero(front.rms <= bound)
    return f"{front.numbers[enough[0]]:,}" if enough.size else f"> {front.numbers[-1]:,}"


def _cost(cost: Cost) -> str:
    if cost.stopped:
        return cost.stopped
    return f"{in_words(cost.total)}, {cost.megabytes:,.0f} MB, {cost.rms:.2f} mm"
