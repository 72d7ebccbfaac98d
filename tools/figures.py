"""Draws the figures of README, docs/lattice.md and docs/tracking.md, the last after Nastar (1994).

A beat that moves, beside its superposition and its volume. Shapes, dispersion and speeds of a
chain; modes of plane, cylinder and torus; modes added over a cylinder at several amplitudes; a
heart tracked over its beat, and modes added to its shape::

    python tools/figures.py
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from modalmotion.clinical import clinical_readouts
from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes import dispersion, group_velocity, phase_velocity
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import (
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    TORUS,
    lattice_coordinates,
    parse_label,
)
from modalmotion.pictures.modes import COLOURS, Extent, draw_moved, draw_shape
from modalmotion.pictures.signature import main_trajectories
from modalmotion.pictures.track import overlay_figure
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import (
    Acquisition,
    PhantomSettings,
    VentricleParameters,
    simulate_images,
    simulate_ventricle,
)
from modalmotion.template import make_template
from modalmotion.template.body_frame import Direction, directions_on
from modalmotion.template.vibration_modes import (
    lattice_modes,
    lattice_modes_named,
    surface_modes_named,
)
from modalmotion.tracking import track as track_through

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "figures"
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"


def chain() -> Figure:
    """Draw a chain's shapes, its dispersion relation (7), and the speeds of its waves."""
    figure = Figure(figsize=(10.0, 3.0), dpi=100, layout="constrained")
    shapes, relation, speeds = figure.subplots(1, 3)
    lattice = Lattice(OPEN_CURVE, (16,))
    modes = lattice_modes(lattice, 4)
    x = lattice_coordinates(lattice.topology, lattice.shape)[:, 0]
    for mode in range(1, 4):
        shapes.plot(x, modes.shapes[:, mode] - 3.5 * mode, "o-", markersize=3, color=BLUE)
        shapes.text(1.02, -3.5 * mode, str(modes.labels[mode]), va="center", fontsize=8)
    shapes.set(title="Shapes of an open chain of 16 nodes", xlabel="x", yticks=[], xlim=(0, 1.3))
    shapes.set_xticks([0.0, 0.5, 1.0])
    k = np.linspace(-np.pi, np.pi, 201)[:, None]
    own = np.pi * np.arange(16) / 16
    relation.plot(k, dispersion(lattice, k), color=BLUE, label="w = 2 |sin(k a / 2)|")
    relation.plot(k, np.abs(k), "--", color="#7d8791", linewidth=1, label="long waves: w = c k")
    relation.plot(own, dispersion(lattice, own[:, None]), "o", color=ORANGE, markersize=3)
    relation.set(title="Dispersion relation, K = M = a = 1", xlabel="k (rad)", ylim=(0, 3.1))
    relation.legend(fontsize=8, loc="upper center")
    half = k[101:]
    speeds.plot(half, phase_velocity(lattice, half), color=BLUE, label="phase, w / k")
    speeds.plot(half, group_velocity(lattice, half), color=GREEN, label="group, dw / dk")
    speeds.set(title="Speed of crests and of pulses", xlabel="k (rad)", ylim=(0, 1.1))
    speeds.legend(fontsize=8)
    return figure


def surfaces() -> Figure:
    """Draw the first modes of a plane, a cylinder and a torus."""
    figure = Figure(figsize=(10.0, 5.4), dpi=100, layout="constrained")
    scale = ScalarMappable(Normalize(-2.0, 2.0), COLOURS)
    for row, topology in enumerate((PLANE, CYLINDER, TORUS)):
        lattice = Lattice(topology, (20, 40))
        template = make_template(standard_surface(lattice))
        modes = lattice_modes(lattice, 12)
        cosines = [k for k, label in enumerate(modes.labels) if label.part == "cos"][1:7]
        for column, mode in enumerate(cosines):
            panel: Any = figure.add_subplot(3, 6, 6 * row + column + 1, projection="3d")
            draw_shape(panel, template, modes.shapes[:, mode], scale)
            panel.set_title(str(modes.labels[mode]), fontsize=9)
    return figure


def superposition() -> Figure:
    """Draw modes added over a cylinder, one after the other, and at growing amplitudes."""
    lattice = Lattice(CYLINDER, (24, 48))
    template = make_template(standard_surface(lattice))
    labels = [parse_label(text) for text in ("1,1,cos", "0,2,sin", "2,3,cos")]
    modes = lattice_modes_named(lattice, labels)
    panels = (
        ("at rest", (0.0, 0.0, 0.0)),
        ("0.15 (1, 1, cos)", (0.15, 0.0, 0.0)),
        ("+ 0.15 (0, 2, sin)", (0.15, 0.15, 0.0)),
        ("+ 0.08 (2, 3, cos)", (0.15, 0.15, 0.08)),
        ("the sum, half of it", (0.075, 0.075, 0.04)),
        ("the sum, turned round", (-0.15, -0.15, -0.08)),
    )
    amplitudes = np.array([a for _, a in panels])
    normals = directions_on(template, Direction.RADIAL)
    positions = template.vertices + (amplitudes @ modes.shapes.T)[:, :, None] * normals
    heights = [modes.shapes @ a for a in amplitudes]
    extent = Extent(template, positions, heights)
    figure = Figure(figsize=(8.0, 5.4), dpi=100, layout="constrained")
    for number, (title, _) in enumerate(panels):
        panel: Any = figure.add_subplot(2, 3, number + 1, projection="3d")
        draw_moved(panel, template, positions[number], heights[number], extent)
        panel.set_title(title, fontsize=9)
    return figure


ADDED = ("at rest", "1,0,cos", "0,2,cos", "2,1,sin")


def tracking(n_frames: int = 25, coarseness: float = 1.0) -> dict[str, Figure]:
    """Draw a phantom's ventricle tracked over its beat, and modes added to the shape found.

    Parameters
    ----------
    n_frames : int
    coarseness : float
        Of the phantom's pixels.
    """
    phantom = simulate_images(
        "cine",
        n_frames=n_frames,
        settings=PhantomSettings(coarseness=coarseness, noise=0.02),
        rng=np.random.default_rng(11),
    )
    track = track_through(phantom.images, landmarks=phantom.landmarks)
    template = track.template
    figure = Figure(figsize=(8.0, 2.4), dpi=100, layout="constrained")
    modes = surface_modes_named(template, [parse_label(text) for text in ADDED[1:]])
    normals = directions_on(template, Direction.RADIAL)
    amplitudes = 4.0 * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    positions = template.vertices + (amplitudes @ modes.shapes.T)[:, :, None] * normals
    heights = [modes.shapes @ a for a in amplitudes]
    extent = Extent(template, positions, heights)
    for number, title in enumerate(ADDED):
        panel: Any = figure.add_subplot(1, len(ADDED), number + 1, projection="3d")
        draw_moved(panel, template, positions[number], heights[number], extent)
        panel.set_title(
            title if number == 0 else f"+ 4 mm ({title.replace(',', ', ')})", fontsize=9
        )
    beat = overlay_figure(track, phantom.images)
    beat.set_size_inches(5.4, 3.6)
    return {
        "tracking-beat.png": beat,
        "tracking-modes.png": figure,
    }


def moving_beat(n_frames: int = 25) -> Iterator[NDArray[np.uint8]]:
    """Draw each frame of a beat as simulated and superposed, beside volume and amplitudes."""
    beat = simulate_ventricle(
        VentricleParameters(ejection_fraction=0.45, akinesia=0.9, akinesia_azimuth=315.0),
        acquisition=Acquisition(n_frames=n_frames),
    )
    template = make_template(beat)
    signatures = [modal_signature(beat, SignatureParameters(modes=n)) for n in (7, 18)]
    readouts = clinical_readouts(signatures[0], beat)
    shown = {"ventricle": beat.vertices.astype(np.float64)}
    shown |= {f"{s.n_amplitudes} amplitudes": reconstruct(s, beat) for s in signatures}
    normals = directions_on(template, Direction.NORMAL)
    inward = {name: ((x - x[0]) * normals).sum(axis=2) for name, x in shown.items()}
    extent = Extent(template, shown["ventricle"], [*inward["ventricle"]])
    times = 1e3 * np.asarray(beat.times)
    largest = np.argsort(-signatures[0].deformation_spectrum)[:4]
    figure = Figure(figsize=(8.4, 2.7), dpi=95)
    canvas = FigureCanvasAgg(figure)
    panels: list[Any] = [
        figure.add_axes((0.225 * k - 0.03, -0.1, 0.28, 1.0), projection="3d") for k in range(3)
    ]
    curves = [figure.add_axes((0.76, bottom, 0.225, 0.34)) for bottom in (0.6, 0.16)]
    for frame in range(n_frames):
        for panel, (name, x) in zip(panels, shown.items(), strict=True):
            panel.clear()
            draw_moved(panel, template, x[frame], inward[name][frame], extent)
            panel.set_title(name, fontsize=10, y=1.0)
        for axes, values, label in (
            (curves[0], readouts.curve.volumes * readouts.shown_in, "volume (ml)"),
            (curves[1], main_trajectories(signatures[0])[:, largest], "amplitudes (mm)"),
        ):
            axes.clear()
            axes.plot(times, values, linewidth=1.3)
            axes.axvline(times[frame], color="#222222", linewidth=0.8)
            axes.set_ylabel(label, fontsize=8)
            axes.tick_params(labelsize=7)
        curves[0].set_xticklabels([])
        curves[1].set_xlabel("time (ms)", fontsize=8)
        canvas.draw()
        yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def gif(pictures: Iterable[NDArray[np.uint8]], milliseconds: int = 60) -> bytes:
    """Write a small GIF: all pictures in the same colours."""
    drawn = [*pictures]
    images = [Image.fromarray(picture) for picture in drawn]
    palette = Image.fromarray(np.vstack([picture[::2, ::2] for picture in drawn])).quantize(200)
    reduced = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    buffer = io.BytesIO()
    reduced[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=reduced[1:],
        duration=milliseconds,
        loop=0,
        optimize=True,
    )
    return buffer.getvalue()


FIGURES = {
    "lattice-chain.png": chain,
    "lattice-modes.png": surfaces,
    "lattice-superposition.png": superposition,
}
"""By the name of the file."""


def draw(folder: Path = FOLDER) -> None:
    """Write all figures to a folder."""
    (folder / "beat.gif").write_bytes(gif(moving_beat()))
    figures = {name: make() for name, make in FIGURES.items()} | tracking()
    for name, figure in figures.items():
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png")
        # A third of the size, and no difference that is seen.
        Image.open(buffer).convert("RGB").quantize(64).save(folder / name, optimize=True)


if __name__ == "__main__":
    draw()
