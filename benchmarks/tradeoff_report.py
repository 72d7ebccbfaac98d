"""The text of docs/tradeoff.md: the answer first, then tables, then plots."""

from __future__ import annotations

import platform
import textwrap
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from measure import Table
from tradeoff_bases import BELTRAMI, CLOSED, PCA, SPRINGS, Front
from tradeoff_sizes import CAP_SECONDS, LATTICE, Cost


@dataclass(frozen=True)
class Report:
    """Everything that was measured in one run."""

    ventricles: Table
    stages: Table
    bases: Table
    principal: Table
    sizes: Table
    modes: Table
    types: Table
    offsets: Table
    best: dict[str, int]
    fronts: dict[str, dict[str, Front]]
    costs: dict[str, list[Cost]]

    @property
    def tables(self) -> list[Table]:
        """All tables, in the order of the report."""
        return [
            self.ventricles,
            self.stages,
            self.bases,
            self.principal,
            self.sizes,
            self.modes,
            self.types,
            self.offsets,
        ]


def write(report: Report, path: Path) -> None:
    """Write the report, a paragraph or table after the other."""
    path.write_text("\n\n".join(_parts(report)) + "\n")


def said(text: str) -> str:
    """Lay a paragraph out in lines of a hundred."""
    return textwrap.fill(" ".join(text.split()), 100, break_on_hyphens=False)


def listed(*texts: str) -> str:
    """Lay out a list."""
    return "\n".join(
        textwrap.fill(
            " ".join(text.split()),
            100,
            initial_indent="- ",
            subsequent_indent="  ",
            break_on_hyphens=False,
        )
        for text in texts
    )


def markdown(table: Table) -> str:
    """Write a table without the columns of bounds, of which the report has none."""
    head = ["| " + " | ".join(table.columns) + " |", "|" + "---|" * len(table.columns)]
    rows = ["| " + " | ".join(row[: len(table.columns)]) + " |" for row in table.rows]
    return "\n".join([f"*{table.title}.*", "", *head, *rows])


def _parts(report: Report) -> list[str]:
    return [
        "# What each choice costs",
        said(f"""
            Written by `make bench ONLY=tradeoff`: every number is of one run, {_machine()}.
            {_data(report)}
        """),
        "## The short answer",
        _answer(report),
        markdown(report.ventricles),
        said("""
            kB are of the amplitudes as float32; the reference mesh is kept once beside them.
            Compression is 3N over amplitudes, as in Nastar (1994). RMS is by area here: see
            [error.md](error.md).
        """),
        "## Where the time goes",
        markdown(report.stages),
        said("""
            A cohort whose vertices correspond names one template (`?template=`) and pays for
            natural coordinates and modes once.
        """),
        "## Which modes",
        markdown(report.bases),
        _on_bases(report),
        "![RMS left against amplitudes, for each surface](figures/tradeoff-surfaces.png)",
        "## Beside PCA, its basis counted",
        markdown(report.principal),
        _on_principal(report),
        "![RMS left against the numbers to keep](figures/tradeoff-fronts.png)",
        "## From a thousand vertices to a million",
        markdown(report.sizes),
        _on_sizes(report),
        "![Seconds and memory against vertices](figures/tradeoff-sizes.png)",
        "## How many modes",
        markdown(report.modes),
        said("""
            Modes are evaluated, not solved for: time grows with their number, and the QR
            factorisation that makes them fit a mesh with its square. The error of a smooth motion
            falls with every mode; that of a measured one ends at the noise of the measurement.
        """),
        "## float32 or float64",
        markdown(report.types),
        markdown(report.offsets),
        said("""
            All arithmetic is float64. What float32 rounded away in the file cannot be had again:
            near the origin it is far less than any measurement can tell, a kilometre away it is
            not. Such a file is accepted, and its answer says how coarse its coordinates are.
        """),
    ]


def _data(report: Report) -> str:
    if any(name.startswith("real") for name in report.fronts):
        return "Real sequences are no part of the project; those named *real* were at hand."
    return "Simulated surfaces only: no real sequences were at hand."


def _answer(report: Report) -> str:
    rows = {row[0]: row for row in report.ventricles.rows}
    few, usual, many = rows["21"], rows["54"], rows["111"]
    taken = {row[0].split()[0]: row[1] for row in report.stages.rows}
    own = "" if few[3].startswith("not") else f" ({few[3]} mm on the real one)"
    return listed(
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
        f"""**A million vertices** ({report.costs[CLOSED][-1].n_vertices:,}) take
        {_time(report, CLOSED)} as a mesh and {_time(report, LATTICE)} as a lattice. Modes that
        must be solved for: springs {_time(report, SPRINGS)}, Laplace-Beltrami
        {_time(report, BELTRAMI)}.""",
    )


def _time(report: Report, basis: str) -> str:
    cost = report.costs[basis][-1]
    return cost.stopped or f"{cost.total:.1f} s and {cost.megabytes:,.0f} MB"


def _on_bases(report: Report) -> str:
    wins = ", ".join(f"{name} on {n}" for name, n in report.best.items())
    return listed(
        f"With 21 amplitudes least is left, of {sum(report.best.values())} surfaces, by: {wins}.",
        f"""**Closed form**: the only modes that mean the same on another mesh, in another patient,
        from another scanner. No eigensolve, no sign and no order to settle, the same bits
        everywhere. {_on_the_real(report)} On a sheet whose corners nobody states, natural
        coordinates have nothing to hold on to, and modes that are solved for leave much less.""",
        """**Spring modes of the mesh**: for surfaces of no known topology, where they take over by
        themselves. They follow the triangulation, and their amplitudes compare within one
        connectivity only.""",
        """**Laplace-Beltrami modes of the surface**: hardly depend on the triangulation, but belong
        to one shape: another patient's have other signs, another order, and mix where frequencies
        come close. Good for one long sequence of a shape with details.""",
    )


def _on_the_real(report: Report) -> str:
    found = report.fronts.get("real: lv_endocardium")
    if found is None:
        return ""
    closed, own = found[CLOSED], found[BELTRAMI]
    pairs = ", ".join(
        f"{closed.at(n):.2f} against {own.at(n):.2f} mm with {n}" for n in (21, 54, 111)
    )
    return f"On the real endocardium they leave, beside Laplace-Beltrami modes, {pairs}."


def _on_principal(report: Report) -> str:
    name = next(iter(report.fronts))
    found = report.fronts[name]
    one, front = found[PCA], found[CLOSED]
    return said(f"""
        PCA of a sequence is the best basis for it, by definition, and must itself be kept: one
        component of the {name} takes {one.numbers[0]:,} numbers and leaves {one.rms[0]:.2f} mm;
        as many numbers in closed form hold {_held(front, int(one.numbers[0]))}. PCA pays for long
        sequences of one mesh, hundreds of frames; or trained on a cohort, whose motions it then
        knows, and no others.
    """)


def _held(front: Front, numbers: int) -> str:
    within = [k for k in range(len(front.numbers)) if front.numbers[k] <= numbers]
    if not within:
        return "less than one mode"
    k = within[-1]
    return f"{front.amplitudes[k]} amplitudes a frame and leave {front.rms[k]:.2f} mm"


def _on_sizes(report: Report) -> str:
    stages = report.costs[CLOSED][-1].seconds
    shares = ", ".join(f"{name} {value:.2g} s" for name, value in stages.items())
    of_largest = f"On the largest mesh: {shares}." if stages else ""
    return said(f"""
        Each cell had a process of its own with one thread, ended after {CAP_SECONDS} s of the
        processor; what cannot end before is not run. Memory is the peak above the sequence
        itself. A
        lattice needs no factorisation; on a mesh natural coordinates are one sparse solution, and
        the rest is products with the vertices. {of_largest} PCA is the eigenproblem between 12
        frames; its error is of this sequence only, for which its basis was made.
    """)


def _machine() -> str:
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy"))
    return f"on {platform.machine()}, Python {platform.python_version()}, {packages}"
