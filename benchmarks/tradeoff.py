"""The trade of accuracy against time, memory and numbers: writes docs/tradeoff.md."""

from __future__ import annotations

import platform
import textwrap
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from measure import Table, in_words, side_by_side
from real_data import is_there, recording
from tradeoff_bases import BELTRAMI, CLOSED, PCA, ROOT, SPRINGS, Front, fronts, surfaces, ventricle
from tradeoff_sizes import CAP_SECONDS, LATTICE, N_MODES, ORDER, Cost, costs

from modalmotion.choice.fitter import Fitter
from modalmotion.clinical import clinical_readouts
from modalmotion.fit.basis import make_basis
from modalmotion.formats import read_npz, write_npz
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.pictures.readouts import volume_figure
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import signature_to_hdf5
from modalmotion.template import choose_modes, make_template

DOCS = ROOT / "docs"
COUNTS = (4, 7, 18, 37, 61)
N_VENTRICLES = 20
STYLES = {CLOSED: ("#1f5fa8", "o"), SPRINGS: ("#d95f02", "^"), BELTRAMI: ("#1b9e77", "v")}

Fronts = dict[str, dict[str, Front]]
Costs = dict[str, list[Cost]]


def run(_folder: Path) -> list[Table]:
    """Measure everything; write docs/tradeoff.md and its figures."""
    by_surface = {name: fronts(sequence) for name, sequence in surfaces().items()}
    by_size = costs()
    tables = [ventricles(), stages(), bases(by_surface), principal(by_surface), sizes(by_size)]
    figures = DOCS / "figures"
    draw_surfaces(by_surface, figures / "tradeoff-surfaces.png")
    beat = ventricle(1200, seed=3)
    readouts = clinical_readouts(modal_signature(beat), beat)
    volume_figure(readouts).savefig(figures / "volume.png", dpi=100)
    page = "\n\n".join(_parts(tables, by_size)) + "\n"
    (DOCS / "tradeoff.md").write_text(page)
    return tables


def draw_surfaces(by_surface: dict[str, dict[str, Front]], path: Path) -> None:
    """Error against amplitudes, a panel for each surface."""
    columns = 3
    rows = -(-len(by_surface) // columns)
    figure = Figure(figsize=(11.0, 2.9 * rows), layout="constrained")
    panels = [figure.add_subplot(rows, columns, k + 1) for k in range(len(by_surface))]
    for (name, found), axes in zip(by_surface.items(), panels, strict=True):
        for basis, (colour, marker) in STYLES.items():
            front = found[basis]
            axes.loglog(
                front.amplitudes,
                np.maximum(front.rms, 1e-4 * front.motion) / front.motion,
                lw=1.4,
                marker=marker,
                ms=2.5,
                color=colour,
                label=basis,
            )
        axes.set_title(name, fontsize=9)
        axes.grid(alpha=0.25, which="both", lw=0.5)
        axes.set_ylim(1e-3, 1.3)
    for k, axes in enumerate(panels):
        if k % columns == 0:
            axes.set_ylabel("RMS left / motion")
        if k + columns >= len(by_surface):
            axes.set_xlabel("amplitudes a frame")
    panels[0].legend(fontsize=8, frameon=False, loc="lower left")
    figure.savefig(path, dpi=90)


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
        own = ("not at hand",) * 2
        if real is not None:
            own = tuple(f"{value:.2f}" for value in _left_and_off(real, k))  # type: ignore[assignment]
        cells = [
            f"{f(x):.2f}" for x in (left, off) for f in (np.median, partial(np.quantile, q=0.9))
        ]
        kept = (f"{4 * 3 * k * 25 / 1000:.1f}", f"{1200 / k:.0f}")
        table.add(f"{3 * k}", *cells[:2], own[0], *cells[2:], own[1], *kept)
    return table


def stages() -> Table:
    """Where the time of the usual request goes."""
    made = ventricle(1500)
    sequence = mesh_sequence(made.vertices.astype(np.float32), made.faces, unit="mm")
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
    table = Table("A beat of 25 frames and 1,500 vertices, fastest of 15 runs", ("stage", "time"))
    for name, taken in side_by_side(calls, n_samples=15).items():
        table.add(name, in_words(taken.best))
    return table


def bases(by_surface: Fronts) -> Table:
    """RMS of each basis with the same number of amplitudes."""
    kinds = (CLOSED, SPRINGS, BELTRAMI)
    table = Table("RMS left, mm, with 21 / 54 / 111 amplitudes a frame", ("surface", *kinds))
    for name, found in by_surface.items():
        cells = (
            " / ".join(f"{found[kind].at(a):.3f}" for a in (21, 54, 111))
            if kind in found
            else "none"
            for kind in kinds
        )
        table.add(name, *cells)
    return table


def principal(by_surface: Fronts) -> Table:
    """PCA beside the closed form, by the numbers that must be kept."""
    shares = (0.2, 0.1, 0.05)
    heads = [
        head for share in shares for head in (f"{share:.0%}: {CLOSED}".replace("%", " %"), PCA)
    ]
    table = Table(
        "Numbers to keep beyond the reference mesh, until the RMS left is a share of the motion",
        ("surface", *heads),
    )
    for name, found in by_surface.items():
        motion = found[CLOSED].motion
        pairs = ((found[kind], share * motion) for share in shares for kind in (CLOSED, PCA))
        table.add(name, *(_numbers(front, bound) for front, bound in pairs))
    return table


def sizes(by_size: Costs) -> Table:
    """Seconds and memory against size."""
    table = Table(
        "Time, memory above the input, RMS left; 12 frames, 7 modes (PCA: components)",
        ("basis", *(f"{size.n_vertices:,} vertices" for size in by_size[CLOSED])),
    )
    for name in ORDER:
        table.add(name, *(_cost(cost) for cost in by_size[name]))
    return table


def _parts(tables: list[Table], by_size: Costs) -> list[str]:
    of_ventricles, of_stages, of_bases, of_pca, of_sizes = map(_markdown, tables)
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy"))
    return [
        "# What each choice costs",
        _said(f"""
            Written by `make bench ONLY=tradeoff`: every number is of one run, on
            {platform.machine()}, Python {platform.python_version()}, {packages}. Real sequences
            are no part of the project; those named *real* were at hand. What is
            measured at every change is in the table of truth (`make truth`).
        """),
        "## The short answer",
        _answer(tables[0], tables[1], by_size),
        of_ventricles,
        _said("""
            kB are of the amplitudes as float32; the reference mesh is kept once beside them.
            Compression is 3N over amplitudes, as in Nastar (1994). RMS is by area here: see
            [error.md](error.md).
        """),
        "## Where the time goes",
        of_stages,
        _said("""
            A cohort whose vertices correspond names one template (`?template=`) and pays for
            natural coordinates and modes once.
        """),
        "## Which modes",
        of_bases,
        _listed(
            """**Closed form**: the only modes that mean the same on another mesh, in another
            patient, from another scanner. No eigensolve, no sign and no order to settle, the same
            bits everywhere. On a sheet whose corners nobody states, natural coordinates have
            nothing to hold on to, and modes that are solved for leave much less.""",
            """**Spring modes of the mesh**: for surfaces of no known topology, where they take
            over by themselves. They follow the triangulation, and their amplitudes compare within
            one connectivity only.""",
            """**Laplace-Beltrami modes of the surface**: hardly depend on the triangulation, but
            belong to one shape: another patient's have other signs, another order, and mix where
            frequencies come close. Good for one long sequence of a shape with details.""",
        ),
        "![RMS left against amplitudes, for each surface](figures/tradeoff-surfaces.png)",
        "## Beside PCA, its basis counted",
        of_pca,
        _said("""
            PCA of a sequence is the best basis for it, by definition, and must itself be kept. It
            pays for long sequences of one mesh, hundreds of frames; or trained on a cohort, whose
            motions it then knows, and no others.
        """),
        "## From a thousand vertices to a million",
        of_sizes,
        _said(f"""
            Each cell had a process of its own with one thread, ended after {CAP_SECONDS} s of the
            processor; what cannot end before is not run. Memory is the peak above the sequence
            itself. A lattice needs no factorisation; on a mesh natural coordinates are one sparse
            solution, and the rest is products with the vertices. PCA is the eigenproblem between
            12 frames; its error is of this sequence only, for which its basis was made.
        """),
    ]


def _answer(of_ventricles: Table, of_stages: Table, by_size: Costs) -> str:
    rows = {row[0]: row for row in of_ventricles.rows}
    few, usual, many = rows["21"], rows["54"], rows["111"]
    taken = {row[0].split()[0]: row[1] for row in of_stages.rows}
    own = "" if few[3].startswith("not") else f" ({few[3]} mm on the real one)"
    largest = {name: found[-1] for name, found in by_size.items()}
    times = {
        name: cost.stopped or f"{cost.total:.1f} s and {cost.megabytes:,.0f} MB"
        for name, cost in largest.items()
    }
    return _listed(
        f"""**21 amplitudes a frame leave {few[1]} mm RMS** of a simulated ventricle's beat{own}
        and give its ejection fraction within {few[4]} points ({few[5]} in nine of ten). 54 leave
        {usual[1]} mm and {usual[4]} points, 111 leave {many[1]} mm and {many[4]}.""",
        """**To compare patients, to classify, to read volumes: 21. To show the moving surface:
        54.** To keep a sequence in place of its meshes: the codec, which finds the number for the
        error that you allow.""",
        f"""**The modes cost next to nothing.** A beat is fitted in {taken["fit"]}, its modes are
        evaluated in {taken["evaluate"]}; laying coordinates over a new mesh takes
        {taken["natural"]}, reading its file {taken["read"]}. Asking for fewer modes than 7 saves
        no time that anyone notices.""",
        f"""**A million vertices** ({largest[CLOSED].n_vertices:,}) take {times[CLOSED]} as a mesh
        and {times[LATTICE]} as a lattice. Modes that must be solved for: springs
        {times[SPRINGS]}, Laplace-Beltrami {times[BELTRAMI]}. With the extra `large` the mesh
        takes half of that time and 1.1 GB ([decision 46](decisions/0046-large-meshes.md)).""",
    )


def _said(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), 100, break_on_hyphens=False)


def _listed(*texts: str) -> str:
    return "\n".join(textwrap.indent(_fill(text), "  ").replace("  ", "- ", 1) for text in texts)


def _fill(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), 98, break_on_hyphens=False)


def _markdown(table: Table) -> str:
    """Write a table without the columns of bounds, of which the page has none."""
    head = ["| " + " | ".join(table.columns) + " |", "|" + "---|" * len(table.columns)]
    rows = ["| " + " | ".join(row[: len(table.columns)]) + " |" for row in table.rows]
    return "\n".join([f"*{table.title}.*", "", *head, *rows])


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
