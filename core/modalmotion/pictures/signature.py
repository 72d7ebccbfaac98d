"""Pictures of a signature and of its trade-off. They need matplotlib (extra ``plot``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion.mesh import alignment, lattice_faces
from modalmotion.mesh.sequence import MEAN, MM_PER_UNIT, MeshSequence
from modalmotion.pictures import views
from modalmotion.representation import Floats, Ints, counted, numeral
from modalmotion.signature import choice, nested_modes, reconstruction
from modalmotion.signature.making import ModalSignature, resolve_sequence
from modalmotion.signature.mode_names import COLOURS, mode_colour, mode_dash, mode_name
from modalmotion.signature.tradeoff import Front, Tradeoff

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_COLOURED: Final = 6
_OTHERS: Final = "#b9bdc1"
_MOST_LABELS: Final = 24


def main_trajectories(signature: ModalSignature) -> Floats:
    """Project each mode's amplitudes on the direction in which they vary most.

    Returns
    -------
    (frames, modes) float64, `unit`
        Signed so that the value farthest from zero is positive.
    """
    # A = U S V^T; the first row of V^T is the direction with the largest sum of squares.
    of_modes = signature.body_amplitudes.transpose(1, 0, 2)
    _, _, directions = np.linalg.svd(of_modes, full_matrices=False)
    trajectories: Floats = np.einsum("mfd,md->fm", of_modes, directions[:, 0])
    farthest = np.take_along_axis(trajectories, np.abs(trajectories).argmax(axis=0)[None], axis=0)
    return np.where(farthest < 0.0, -trajectories, trajectories)


def draw_trajectories(axes: Any, signature: ModalSignature, shown: views.ShownUnit) -> None:
    """Draw amplitudes over time, the largest modes in colour."""
    at, label = views.time_axis(signature.times, signature.n_frames)
    trajectories, colours = main_trajectories(signature) / shown.size, _colours(signature)
    # The largest last, so that they are on top.
    for mode in np.argsort(signature.deformation_spectrum, kind="stable"):
        colour = colours[mode]
        is_named = colour != _OTHERS
        axes.plot(
            at,
            trajectories[:, mode],
            color=colour,
            ls=(0, mode_dash(signature.modes.labels[mode])) if is_named else "-",
            lw=1.8 if is_named else 0.8,
            marker=_marker(at),
        )
    axes.set_title("Amplitudes, each along its main direction", fontsize=10)
    axes.set(xlabel=label, ylabel=shown.name)
    views.lighten(axes)


def draw_spectrum(axes: Any, signature: ModalSignature, shown: views.ShownUnit) -> None:
    """Draw the deformation spectrum, a bar for each mode in the order of the signature."""
    spectrum = signature.deformation_spectrum / shown.size
    places = np.arange(len(spectrum))
    axes.barh(places, spectrum, color=_colours(signature), height=0.75)
    axes.invert_yaxis()
    if len(spectrum) <= _MOST_LABELS:
        axes.set_yticks(places, _names(signature), fontsize=8)
    else:
        axes.set_ylabel("mode, by its place in the signature")
    axes.set_title("Deformation spectrum: RMS over frames", fontsize=10)
    axes.set_xlabel(shown.name)
    views.lighten(axes, grid="x")


def draw_errors(axes: Any, signature: ModalSignature, shown: views.ShownUnit) -> None:
    """Draw the motion of the surface in each frame, and the error of the amplitudes."""
    at, label = views.time_axis(signature.times, signature.n_frames)
    marker = _marker(at)
    motion = signature.motion_rms / shown.size
    rms, largest = signature.rms_errors / shown.size, signature.max_errors / shown.size
    axes.fill_between(at, motion, color="#dfe3e8", lw=0)
    axes.plot(at, motion, color="#8a939c", label="motion, RMS", marker=marker)
    axes.plot(at, largest, "--", color=COLOURS[1], label="error, largest", marker=marker)
    axes.plot(at, rms, color=COLOURS[0], label="error, RMS", marker=marker)
    axes.set_title(
        f"Error of all frames {numeral(signature.rms_error / shown.size, 2)} RMS, "
        f"{numeral(signature.max_error / shown.size, 2)} at most",
        fontsize=10,
    )
    axes.set(xlabel=label, ylabel=shown.name)
    # There is space for the legend above the curves.
    axes.set_ylim(0.0, 1.18 * max(float(motion.max()), float(largest.max())) or 1.0)
    views.lighten(axes)
    axes.legend(fontsize=8, frameon=False, ncols=3, loc="upper center", columnspacing=1.2)


def _colours(signature: ModalSignature) -> list[str]:
    """Assign a colour to each of the largest moving modes."""
    spectrum = signature.deformation_spectrum
    colours = [_OTHERS] * len(spectrum)
    for mode in np.argsort(-spectrum, kind="stable")[:_MOST_COLOURED].tolist():
        if spectrum[mode] > 0.0:
            colours[mode] = mode_colour(signature.modes.labels[mode])
    return colours


def _names(signature: ModalSignature) -> list[str]:
    """Describe each mode, once for a pair, with its label."""
    names, before = [], ""
    for label in signature.modes.labels:
        name = mode_name(signature, label)
        names.append(str(label) if name == before else f"{name}  {label}")
        before = name
    return names


def _marker(at: Floats) -> str | None:
    # One frame alone has no line.
    return "o" if len(at) == 1 else None


_SURFACE = "#c9c4bc"
_REFERENCE = "#7d8791"
# Degrees from which surfaces are seen.
_ELEVATION = 12.0
_AZIMUTH = -70.0


def signature_figure(sequence: MeshSequence, signature: ModalSignature) -> Figure:
    """Draw a signature with its motion: surfaces, trajectories, spectrum, error.

    Top: the reference, the frame farthest from it, its reconstruction, and the error. Bottom: the
    amplitudes over time, their spectrum, and motion and error by frame.

    Parameters
    ----------
    sequence : MeshSequence
    signature : ModalSignature
        Made from that sequence.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = views.new_figure(14.0, 8.4)
    above, below = figure.subfigures(2, 1, height_ratios=(1.15, 1.0), squeeze=False)[:, 0]
    _draw_surfaces(above, sequence, signature, _shown_unit(signature))
    _draw_amplitudes(below, signature)
    figure.suptitle(_title(signature), fontsize=12)
    return figure


def amplitudes_figure(signature: ModalSignature) -> Figure:
    """Draw a signature alone: amplitudes over time, their spectrum, motion and error by frame.

    Parameters
    ----------
    signature : ModalSignature

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = views.new_figure(14.0, 4.0)
    _draw_amplitudes(figure, signature)
    figure.suptitle(_title(signature), fontsize=12)
    return figure


def _draw_amplitudes(figure: Any, signature: ModalSignature) -> None:
    shown = _shown_unit(signature)
    of_modes, spectrum, errors = figure.subplots(1, 3, width_ratios=(1.2, 1.0, 1.2))
    draw_trajectories(of_modes, signature, shown)
    draw_spectrum(spectrum, signature, shown)
    draw_errors(errors, signature, shown)


def _shown_unit(signature: ModalSignature) -> views.ShownUnit:
    largest = max(float(signature.motion_rms.max()), signature.max_error)
    return views.shown_unit(largest, signature.unit)


def _title(signature: ModalSignature) -> str:
    return (
        f"{signature.surface}: {counted(signature.n_frames, 'frame')} of {signature.n_vertices} "
        f"vertices, {counted(len(signature.modes), 'mode')}, "
        f"{signature.compression:.0f}:1 per frame"
    )


def _draw_surfaces(
    figure: Any, sequence: MeshSequence, signature: ModalSignature, shown: views.ShownUnit
) -> None:
    # Farthest from the reference: end systole for a ventricle.
    frame = int(np.argmax(signature.motion_rms))
    reference = alignment.reference_positions(sequence, signature.parameters.reference)
    true = sequence.vertices[frame].astype(np.float64)
    superposed = reconstruction.reconstruct(signature, sequence, [frame])[0]
    # Divided first: squares of very large or very small numbers overflow or vanish.
    error = np.linalg.norm(superposed / shown.size - true / shown.size, axis=1)
    moved, left, most = (
        float(values[frame]) / shown.size
        for values in (signature.motion_rms, signature.rms_errors, signature.max_errors)
    )
    start = signature.parameters.reference
    left_words, most_words = (numeral(one, 2, of=moved) for one in (left, most))
    panels = [
        (reference, None, "Mean shape" if start == MEAN else f"Reference (frame {start})"),
        (true, None, f"Frame {frame}, moved {numeral(moved, 2)} {shown.name} RMS"),
        (superposed, None, f"From {signature.n_amplitudes} amplitudes"),
        (true, error, f"Error {left_words} {shown.name} RMS, max {most_words}"),
    ]
    # Surfaces have no axes, and so no unit.
    size = float(max(np.abs(reference).max(), np.abs(true).max())) or 1.0
    view = views.apex_down(reference / size)
    box = np.concatenate([reference, true]) / size @ view
    faces = _faces(sequence, signature)
    for column, (vertices, values, title) in enumerate(panels):
        axis = figure.add_subplot(1, len(panels), column + 1, projection="3d")
        drawn = _draw(axis, vertices / size @ view, faces, values, box)
        axis.set_title(title, fontsize=10)
        if column == 0:
            stated: dict[str, Any] = {
                "unit": sequence.unit,
                "coordinates": sequence.facts.coordinates,
            }
            views.draw_scale(axis, box, view, size=size, azimuth=_AZIMUTH, **stated)
        if values is not None:
            label = f"distance to true vertex ({shown.name})"
            figure.colorbar(drawn, ax=axis, shrink=0.7, pad=0.02, label=label)


def _faces(sequence: MeshSequence, signature: ModalSignature) -> Ints:
    if len(sequence.faces):
        return sequence.faces
    resolved = resolve_sequence(sequence, signature.parameters)
    grid, topology = resolved.grid, signature.topology
    if topology is not None and grid is not None and len(grid) == 2 and min(grid) > 1:
        return lattice_faces(topology, grid)
    return sequence.faces


def _draw(axis: Any, vertices: Floats, faces: Ints, values: Floats | None, box: Floats) -> Any:
    from matplotlib.colors import LightSource
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    views.fill_cube(axis, box, _ELEVATION, _AZIMUTH)
    if not len(faces):
        segments = np.stack([vertices[:-1], vertices[1:]], axis=1)
        drawn = Line3DCollection(segments, colors=_REFERENCE, linewidths=1.5)
        if values is not None:
            drawn.set(colors=None, cmap="viridis")
            drawn.set_array((values[:-1] + values[1:]) / 2)
    elif values is None:
        drawn = Poly3DCollection(
            vertices[faces],
            facecolors=_SURFACE,
            edgecolors=(0, 0, 0, 0.12),
            linewidths=0.2,
            shade=True,
            lightsource=LightSource(azdeg=300, altdeg=40),
        )
    else:
        drawn = Poly3DCollection(
            vertices[faces], cmap="viridis", edgecolors=(0, 0, 0, 0.08), linewidths=0.2
        )
        drawn.set_array(values[faces].mean(axis=1))
        drawn.set_clim(0.0, max(float(values.max()), 1e-12))
    axis.add_collection3d(drawn)
    return drawn


_COLOURS: Final = ("#1f6f8b", "#c8553d", "#6a8d3f", "#7a5195", "#8c6d31", "#444444")
_CHOSEN: Final = "#d62728"

# Below this share of the motion an error is rounding and would only stretch the scale.
_SMALLEST_SHARE: Final = 1e-4


def tradeoff_figure(tradeoff: Tradeoff) -> Figure:
    """Draw error against amplitudes and against bytes, and time against both.

    Lines are topologies and components; in the second panel the dots below them are amplitudes
    limited to harmonics over time. The star is the requested point.

    Parameters
    ----------
    tradeoff : Tradeoff

    Returns
    -------
    matplotlib.figure.Figure
    """
    front = tradeoff.front
    factor = 1.0 if front.unit is None else MM_PER_UNIT[front.unit]
    shown = views.shown_unit(factor * front.motion_rms, None if front.unit is None else "mm")
    unit = shown.name
    factor /= shown.size
    has_times = bool(tradeoff.fit_milliseconds)
    figure = views.new_figure(14.0 if has_times else 10.0, 4.6)
    panels: list[Any] = [figure.add_subplot(1, 3 if has_times else 2, 1)]
    panels.append(figure.add_subplot(1, 3 if has_times else 2, 2, sharey=panels[0]))
    for number, branch in enumerate(front.branches):
        colour = _COLOURS[number % len(_COLOURS)]
        name = f"{branch.topology}, {branch.components}"
        style = {"color": colour, "linewidth": 1.6, "label": name, "zorder": 3}
        panels[0].plot(3 * branch.counts, factor * branch.rms, **style)
        whole = np.array([8 * front.numbers(n) for n in branch.counts.tolist()])
        panels[1].plot(whole, factor * branch.rms, **style)
    sizes, errors = _lower_hull(front)
    style = {"color": "#222222", "linewidth": 1.2, "linestyle": ":", "zorder": 4}
    panels[1].plot(sizes, factor * errors, label="best with fewer harmonics", **style)
    _simple_kinds(panels, tradeoff, factor)
    price = tradeoff.chosen.price
    # Prices are in mm already if the unit is known.
    left = price.rms_error / shown.size
    star = {"marker": "*", "markersize": 15, "markeredgecolor": "white", "zorder": 6}
    # A logarithmic scale has no zero.
    for panel, x in zip(
        panels, (max(price.amplitudes_per_frame, 1), max(price.bytes, 8)), strict=True
    ):
        if left > 0:
            words = f"chosen: {left:.3g} {unit} RMS"
            panel.plot(x, left, color=_CHOSEN, linestyle="none", label=words, **star)
        if tradeoff.limit is not None:
            limit = factor * tradeoff.limit
            panel.axhline(limit, color=_CHOSEN, linewidth=0.8, linestyle="--", zorder=1)
    largest = max(factor * front.motion_rms, 1e-300)
    errors = np.concatenate([branch.rms for branch in front.branches]) * factor
    smallest = float(errors[errors > _SMALLEST_SHARE * largest].min(initial=largest))
    smallest = min(smallest, left) if left > 0 else smallest
    for panel, label in zip(
        panels, ("amplitudes per frame", "bytes of the trajectory (float64)"), strict=False
    ):
        panel.set(xscale="log", yscale="log", xlabel=label, ylim=(0.7 * smallest, 1.5 * largest))
        panel.grid(True, which="both", color="#e4e4e4", linewidth=0.6)
    panels[0].set_ylabel(f"RMS error ({unit})")
    panels[0].legend(fontsize=8, loc="upper right")
    panels[1].legend(fontsize=8, loc="lower left")
    _plain_ticks(panels[0].yaxis)
    _plain_ticks(panels[0].xaxis)
    if has_times:
        _draw_times(figure.add_subplot(1, 3, 3), tradeoff, factor, unit)
    figure.suptitle(_tradeoff_title(tradeoff, shown, factor), fontsize=11)
    return figure


def _lower_hull(front: Front) -> tuple[Floats, Floats]:
    """Bytes and error of the points that no other point beats in both."""
    points = [
        (8.0 * 3 * count * min(nested_modes.n_functions(h), front.n_frames), float(error))
        for branch in front.branches
        for count, row in zip(branch.counts.tolist(), branch.joint_rms, strict=True)
        for h, error in enumerate(row)
    ]
    best, hull = np.inf, []
    for size, error in sorted(points):
        if error < best:
            best = error
            hull.append((size, error))
    sizes, errors = np.array(hull).T if hull else np.zeros((2, 0))
    return sizes, errors


def _simple_kinds(panels: list[Any], tradeoff: Tradeoff, factor: float) -> None:
    """Mark the motions described by a fixed count of numbers."""
    for kind in (choice.SceneKind.RIGID, choice.SceneKind.AFFINE):
        numbers, error = choice.NUMBERS[kind], factor * tradeoff.scene[kind].rms
        if error <= _SMALLEST_SHARE * factor * tradeoff.front.motion_rms:
            continue
        for panel, x in ((panels[0], numbers), (panels[1], 8 * numbers * tradeoff.front.n_frames)):
            panel.plot(x, error, marker="D", markersize=5, color="#555555", zorder=5)
            _note(panel, kind.value, (x, error), (6, 4))


def _draw_times(panel: Any, tradeoff: Tradeoff, factor: float, unit: str) -> None:
    branch = tradeoff.front.branches[0]
    counts = np.array(sorted(tradeoff.fit_milliseconds))
    spent = np.array([tradeoff.fit_milliseconds[n] for n in counts.tolist()])
    errors = factor * branch.rms[np.searchsorted(branch.counts, counts)]
    panel.plot(3 * counts, spent, color=_COLOURS[0], marker="o", markersize=4, linewidth=1.6)
    for n, ms, error in zip(counts.tolist(), spent.tolist(), errors.tolist(), strict=True):
        _note(panel, f"{error:.2g} {unit}", (3 * n, ms), (5, -10))
    panel.set(
        xscale="log",
        yscale="log",
        xlabel="amplitudes per frame",
        ylabel="time of the whole fit (ms)",
        title=f"time ({branch.topology}, {branch.components}; RMS error at each point)",
    )
    panel.title.set_fontsize(9)
    panel.margins(x=0.15, y=0.25)
    panel.grid(True, which="both", color="#e4e4e4", linewidth=0.6)
    chosen = max(tradeoff.chosen.price.amplitudes_per_frame, 1)
    panel.axvline(chosen, color=_CHOSEN, linewidth=0.8, linestyle="--", zorder=1)
    per_frame = 8 * tradeoff.front.n_frames
    above = panel.secondary_xaxis(
        "top", functions=(lambda a: a * per_frame, lambda b: b / per_frame)
    )
    _plain_ticks(panel.xaxis)
    _plain_ticks(panel.yaxis)
    _plain_ticks(above.xaxis, (1.0, 3.0))
    above.set_xlabel("bytes of the trajectory", fontsize=8)
    above.tick_params(labelsize=8)


def _note(panel: Any, text: str, at: tuple[float, float], aside: tuple[int, int]) -> None:
    style = {"textcoords": "offset points", "fontsize": 8, "color": "#555555"}
    panel.annotate(text, at, xytext=aside, **style)


def _plain_ticks(axis: Any, at: tuple[float, ...] = (1.0, 2.0, 5.0)) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=at))
    axis.set_major_formatter(StrMethodFormatter("{x:,g}"))
    axis.set_minor_formatter(NullFormatter())


def _tradeoff_title(tradeoff: Tradeoff, shown: views.ShownUnit, factor: float) -> str:
    front, chosen = tradeoff.front, tradeoff.chosen
    price, unit = chosen.price, shown.name
    rms, p95, largest = (
        error / shown.size for error in (price.rms_error, price.p95_error, price.max_error)
    )
    text = (
        f"{front.n_frames} frames of {front.n_vertices} vertices, motion "
        f"{factor * front.motion_rms:.3g} {unit} RMS.  Chosen: "
    )
    text += f"{len(chosen.signature.modes)} modes, {price.amplitudes_per_frame} amplitudes, "
    if chosen.signature.parameters.harmonics is not None:
        text += f"{chosen.signature.parameters.harmonics} harmonics, "
    return f"{text}{price.bytes} bytes; {rms:.3g} RMS, {p95:.3g} p95, {largest:.3g} max ({unit})"
