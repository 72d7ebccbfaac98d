"""Plots of docs/tradeoff.md."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from tradeoff_bases import BELTRAMI, CLOSED, PCA, SPRINGS, Front
from tradeoff_sizes import CAP_SECONDS, LATTICE, Cost

from modalmotion.clinical import clinical_readouts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.pictures.readouts import volume_figure
from modalmotion.signature.making import modal_signature

COLOURS = {
    LATTICE: "#7fb2e5",
    CLOSED: "#1f5fa8",
    SPRINGS: "#d95f02",
    BELTRAMI: "#1b9e77",
    PCA: "#666666",
}
MARKERS = {LATTICE: "s", CLOSED: "o", SPRINGS: "^", BELTRAMI: "v", PCA: "D"}


def draw_fronts(by_surface: dict[str, dict[str, Front]], path: Path) -> None:
    """Error against the numbers that must be kept, of ventricles."""
    names = [name for name in by_surface if "ventricle" in name or "endocardium" in name]
    figure, panels = _figure(len(names), (5.6 * len(names), 4.4))
    for name, axes in zip(names, panels, strict=True):
        for basis, front in by_surface[name].items():
            shown = front.rms > 1e-3 * front.motion
            axes.loglog(
                front.numbers[shown],
                front.rms[shown],
                marker=MARKERS[basis],
                ms=4,
                lw=1.3,
                color=COLOURS[basis],
                label=_label(basis),
            )
        motion = next(iter(by_surface[name].values())).motion
        axes.axhline(motion, color="0.6", lw=0.8)
        axes.set_ylim(top=1.6 * motion)
        axes.annotate(
            "the motion itself",
            (axes.get_xlim()[1], motion),
            xytext=(-6, 3),
            textcoords="offset points",
            ha="right",
            fontsize=8,
        )
        front = by_surface[name][CLOSED]
        for amplitudes in (21, 54, 111):
            k = int(np.flatnonzero(front.amplitudes <= amplitudes)[-1])
            axes.annotate(
                f"{front.amplitudes[k]} a frame",
                (front.numbers[k], front.rms[k]),
                xytext=(10, 14),
                textcoords="offset points",
                fontsize=8,
                color=COLOURS[CLOSED],
                arrowprops={"arrowstyle": "-", "color": COLOURS[CLOSED], "lw": 0.7},
            )
        axes.set(xlabel="numbers to keep beyond the reference mesh", ylabel="RMS left (mm)")
        axes.set_title(f"{name}, {len_frames(front)} frames", fontsize=10)
        axes.grid(alpha=0.25, which="both", lw=0.5)
    panels[0].legend(fontsize=8, frameon=False, loc="lower left")
    figure.savefig(path, dpi=100)


def draw_surfaces(by_surface: dict[str, dict[str, Front]], path: Path) -> None:
    """Error against amplitudes, a panel for each surface."""
    columns = 3
    rows = -(-len(by_surface) // columns)
    figure, panels = _figure(rows * columns, (11.0, 2.9 * rows), columns)
    for (name, found), axes in zip(by_surface.items(), panels, strict=False):
        for basis, front in found.items():
            if basis == PCA:
                continue
            axes.loglog(
                front.amplitudes,
                np.maximum(front.rms, 1e-4 * front.motion) / front.motion,
                lw=1.4,
                marker=MARKERS[basis],
                ms=2.5,
                color=COLOURS[basis],
                label=basis,
            )
        axes.set_title(name, fontsize=9)
        axes.grid(alpha=0.25, which="both", lw=0.5)
        axes.set_ylim(1e-3, 1.3)
    for axes in panels[len(by_surface) :]:
        axes.set_axis_off()
    for k, axes in enumerate(panels[: len(by_surface)]):
        if k % columns == 0:
            axes.set_ylabel("RMS left / motion")
        if k + columns >= len(by_surface):
            axes.set_xlabel("amplitudes a frame")
    panels[0].legend(fontsize=8, frameon=False, loc="lower left")
    figure.savefig(path, dpi=90)


def draw_sizes(by_size: dict[str, list[Cost]], path: Path) -> None:
    """Seconds and memory against vertices."""
    figure, (seconds, memory) = _figure(2, (11.0, 4.4))
    for name, found in by_size.items():
        run = [cost for cost in found if not cost.stopped]
        at = [cost.n_vertices for cost in run]
        style: dict[str, Any] = {"marker": MARKERS[name], "color": COLOURS[name], "lw": 1.3}
        seconds.loglog(at, [cost.total for cost in run], label=name, **style)
        memory.loglog(at, [max(cost.megabytes, 0.1) for cost in run], label=name, **style)
        stopped = [cost for cost in found if cost.stopped.startswith(">")]
        for cost in stopped:
            # Side by side where several were ended on one mesh.
            aside = 0.86 ** list(by_size).index(name)
            seconds.plot(
                1.3 * aside * cost.n_vertices, CAP_SECONDS, "x", ms=8, mew=2, color=COLOURS[name]
            )
    seconds.axhline(CAP_SECONDS, color="0.7", lw=0.8)
    seconds.text(1.1e3, CAP_SECONDS * 1.12, "ended after this long", fontsize=8, color="0.4")
    seconds.set(xlabel="vertices", ylabel="seconds", title="Time, 12 frames, 7 modes")
    memory.set(xlabel="vertices", ylabel="MB above the input", title="Memory")
    seconds.set_ylim(top=2.5 * CAP_SECONDS)
    for axes in (seconds, memory):
        axes.grid(alpha=0.25, which="both", lw=0.5)
    memory.legend(fontsize=8, frameon=False, loc="upper left")
    figure.savefig(path, dpi=100)


def draw_volume(sequence: MeshSequence, path: Path) -> None:
    """Draw volume over time of one ventricle, for docs/readouts.md."""
    readouts = clinical_readouts(modal_signature(sequence), sequence)
    volume_figure(readouts).savefig(path, dpi=100)


def len_frames(front: Front) -> int:
    """Frames of the sequence that a front belongs to."""
    return int(front.numbers[0] // front.amplitudes[0])


def _label(basis: str) -> str:
    if basis == PCA:
        return "PCA, its basis counted"
    if basis == CLOSED:
        return basis
    return f"{basis} (an eigensolve at both ends)"


def _figure(n: int, size: tuple[float, float], columns: int | None = None) -> tuple[Any, list[Any]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    wide = n if columns is None else columns
    return figure, [figure.add_subplot(-(-n // wide), wide, k + 1) for k in range(n)]
