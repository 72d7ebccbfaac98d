"""Pictures of a track, over its images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion.errors import ParameterError, TopologyError
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.images.volume import Image
from modalmotion.mesh.geometry import Edges
from modalmotion.pictures.modes import pixels_of, write_gif
from modalmotion.pictures.views import new_figure, shown_unit, size_of, tilted, upright
from modalmotion.representation import Bytes, Floats, numeral
from modalmotion.tracking.result import STRAY, Track

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NORMAL: Final = "#1f5fa8"
_TANGENTIAL: Final = "#c4572b"
_DATA: Final = "#222222"

# Frames drawn side by side.
_N_FRAMES: Final = 6


def data_figure(track: Track) -> Figure:
    """Draw the data over the surface, outliers marked, in frames spread over the beat.

    Parameters
    ----------
    track : Track
        Of a surface.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TopologyError
        If the track is that of a curve.
    ParameterError
        If it has none of its data.
    """
    _require_surface(track)
    data = track.data
    if data is None:
        raise ParameterError(
            "The track does not contain the data that it was tracked through.",
            remedy="Track the recording again: newer tracks contain some of their points.",
        )
    shown = np.unique(np.linspace(0, track.n_frames - 1, _N_FRAMES).astype(np.int64))
    view = tilted(upright(track.template))
    size = size_of(track.template)
    figure = new_figure(2.6 * len(shown), 3.2)
    middle = track.template.weights @ track.template.vertices
    for panel, k in enumerate(shown.tolist()):
        axes: Any = figure.add_subplot(1, len(shown), panel + 1)
        x = (track.sequence.vertices[k] - middle) @ view / size
        axes.triplot(x[:, 0], x[:, 2], track.template.faces, lw=0.25, color=_NORMAL, alpha=0.5)
        rows = data.of_frame(k)
        y = (data.points[rows] - middle) @ view / size
        marks, strays = data.are_landmarks[rows], data.weights[rows] < STRAY
        for chosen, colour, style in (
            (~marks & ~strays, _DATA, {"s": 1.5, "lw": 0}),
            (~marks & strays, _TANGENTIAL, {"s": 2.5, "lw": 0}),
            (marks, _DATA, {"s": 30, "marker": "x"}),
        ):
            axes.scatter(y[chosen, 0], y[chosen, 2], color=colour, zorder=3, **style)
        missing = " (nothing seen)" if k in track.unseen else ""
        axes.set_title(f"frame {k}{missing}", fontsize=9)
        axes.set_aspect("equal")
        axes.set_axis_off()
    rms = track.residuals[:, 0]
    seen = rms[np.isfinite(rms)]
    if len(seen):
        mean = float(seen.mean())
        unit = shown_unit(mean, track.sequence.unit)
        text = f"Data over the surface; residual RMS {numeral(mean / unit.size, 2)} {unit.name}"
        n_strays = int((data.weights < STRAY).sum())
        left_out = f"; {n_strays} of {data.n_points} points are outliers" if n_strays else ""
        figure.suptitle(text + left_out, fontsize=11)
    return figure


def usual_frame(track: Track) -> int:
    """Choose the frame of the smallest volume, or of the largest stated error without volumes."""
    if track.volumes is not None:
        return int(np.argmin(track.volumes))
    return int(np.argmax(track.deviations.mean(axis=(1, 2))))


def deviations_figure(track: Track, frame: int) -> Figure:
    """Draw the stated standard deviation on the surface: across it, and along it.

    Parameters
    ----------
    track : Track
        Of a surface.
    frame : int

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TopologyError
        If the track is that of a curve.
    """
    _require_surface(track)
    view = tilted(upright(track.template))
    x = track.sequence.vertices[frame] @ view / size_of(track.template)
    faces = track.template.faces
    figure = new_figure(8.2, 4.0)
    unit = shown_unit(float(track.deviations[frame].max()), track.sequence.unit)
    for k, name in enumerate(("across the surface", "along it, from the prior")):
        axes: Any = figure.add_subplot(1, 2, k + 1, projection="3d")
        values = track.deviations[frame, :, k][faces].mean(axis=1) / unit.size
        drawn = axes.plot_trisurf(
            x[:, 0], x[:, 1], x[:, 2], triangles=faces, cmap="viridis", lw=0, antialiased=False
        )
        drawn.set_array(values)
        drawn.autoscale()
        axes.set_axis_off()
        axes.set_box_aspect(np.ptp(x, axis=0))
        axes.view_init(elev=0, azim=-90)
        axes.set_title(name, fontsize=10)
        figure.colorbar(drawn, ax=axes, shrink=0.7, label=f"standard deviation ({unit.name})")
    figure.suptitle(f"Stated error in frame {frame}", fontsize=11)
    return figure


def determined_figure(track: Track) -> Figure:
    """Draw the share of each mode that the data determine: across the surface, and along it.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = new_figure(7.2, 3.6)
    from matplotlib.ticker import MaxNLocator

    share: Floats = 100.0 * track.determined
    at = np.arange(len(share))
    axes = figure.add_subplot()
    axes.bar(at - 0.2, share[:, 0], 0.4, color=_NORMAL, label="across the surface")
    axes.bar(at + 0.2, share[:, 1], 0.4, color=_TANGENTIAL, label="along it")
    axes.axhline(50.0, color=_DATA, lw=0.8, ls="--")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="mode, by rank", ylabel="determined by the data (%)", ylim=(0, 105))
    undetermined = int((share[:, 1] < 50.0).sum())
    axes.set_title(
        f"{undetermined} of {len(share)} modes undetermined along the surface", fontsize=11
    )
    axes.legend(fontsize=9, frameon=False, loc="upper right")
    return figure


def _require_surface(track: Track) -> None:
    if not len(track.template.faces):
        raise TopologyError(
            "The track is that of a curve, which has no triangles to draw.",
            remedy="Draw the track of a surface.",
        )


_CONTOUR: Final = "#ffb000"

# Planes from top to bottom, and phases from left to right.
_N_PLANES: Final = 4
_N_PHASES: Final = 6

# Of a plane through a volume: mm around the surface, and samples along a side.
_MARGIN: Final = 20.0
_N_SAMPLES: Final = 120


def overlay_figure(track: Track, images: ImageSequence) -> Figure:
    """Draw the surface's contours over slices, in frames spread over the beat.

    Parameters
    ----------
    track : Track
    images : ImageSequence
        That it was tracked through.

    Returns
    -------
    matplotlib.figure.Figure
    """
    shown = images.sliced()
    frames = np.unique(np.linspace(0, track.n_frames - 1, _N_PHASES).round().astype(np.int64))
    rows, columns = _n_planes(track, shown), len(frames)
    figure = new_figure(2.0 * columns, 2.0 * rows)
    for column, k in enumerate(frames.tolist()):
        places = [row * columns + column + 1 for row in range(rows)]
        panels = [figure.add_subplot(rows, columns, place) for place in places]
        _draw_planes(track, shown, k, panels)
    return figure


def overlay_gif(track: Track, images: ImageSequence) -> bytes:
    """Draw the surface's contours over slices in every frame, as a GIF that repeats.

    Parameters
    ----------
    track : Track
    images : ImageSequence
        That it was tracked through.

    Returns
    -------
    bytes
        Its duration is that of the recording if its times are known, otherwise a second.
    """
    shown = images.sliced()
    n = _n_planes(track, shown)

    def drawn(k: int) -> Bytes:
        figure = new_figure(2.4 * n, 2.6, dpi=100)
        panels = [figure.add_subplot(1, n, place) for place in range(1, n + 1)]
        _draw_planes(track, shown, k, panels)
        return pixels_of(figure)

    times = track.sequence.times
    step = 1.0 / track.n_frames if times is None or len(times) < 2 else float(np.diff(times).mean())
    return write_gif(map(drawn, range(track.n_frames)), step)


def _n_planes(track: Track, images: ImageSequence) -> int:
    first = next(frame for frame in images.frames if frame is not None)
    return min(_N_PLANES, len(_planes(first, track.sequence.vertices.astype(np.float64))))


def _draw_planes(track: Track, images: ImageSequence, k: int, all_axes: Sequence[Any]) -> None:
    """Draw contours over the planes of a frame, each in its axes; a missing frame is empty."""
    image, x = images.frames[k], track.sequence.vertices.astype(np.float64)
    shifts = () if track.images is None else track.images.shifts
    edges = Edges.of(track.template.faces)
    all_axes[0].set_title(f"frame {k}", fontsize=8)
    for axes in all_axes:
        axes.set_axis_off()
    chosen = [] if image is None else _planes(image, x)
    for axes, (number, plane) in zip(all_axes, chosen, strict=False):
        low, high = np.nanpercentile(plane.values.astype(np.float64), (1, 99.5))
        axes.imshow(plane.values, cmap="gray", vmin=low, vmax=high)
        shift = np.array(shifts[number]) if shifts else np.zeros(3)
        for segment in contours_in(plane, x[k], edges, shift):
            axes.plot(segment[:, 1], segment[:, 0], color=_CONTOUR, linewidth=0.8)
        _zoom(axes, plane, x)


def contours_in(plane: Plane, x: Floats, edges: Edges, shift: Floats) -> Floats:
    """Cut a surface with a plane.

    Parameters
    ----------
    plane : Plane
    x : (vertices, 3) float64, mm
    edges : Edges
        Of the surface.
    shift : (3,) float64, mm
        Shift of the plane's content.

    Returns
    -------
    (segments, 2, 2) float64
        Ends of each segment, in indices of the plane.
    """
    cut = edges.cut(x, plane.heights(x))
    places = (cut.shares[:, :, None] * x[cut.corners]).sum(axis=1) + shift
    return plane.indices(places)[cut.segments]


def _planes(image: Image, x: Floats) -> list[tuple[int, Plane]]:
    """Choose planes to show, with their numbers; of a volume three through the surface's centre.

    Of planes those that the surface passes through in all frames, if there are any.
    """
    if isinstance(image, PlaneSet):
        heights = [plane.heights(x.reshape(-1, 3)).reshape(x.shape[:2]) for plane in image.planes]
        is_cut = [bool(((h.min(axis=1) < 0) & (h.max(axis=1) > 0)).all()) for h in heights]
        numbers = np.flatnonzero(is_cut) if any(is_cut) else np.arange(len(image))
        chosen = np.unique(np.linspace(0, len(numbers) - 1, _N_PLANES).round().astype(np.int64))
        return [(k, image.planes[k]) for k in numbers[chosen].tolist()]
    return [(0, plane) for plane in _cuts(image, x)]


def _cuts(volume: Volume, x: Floats) -> list[Plane]:
    everywhere = x.reshape(-1, 3)
    middle = everywhere.mean(axis=0)
    side = float(np.ptp(everywhere, axis=0).max()) + 2.0 * _MARGIN
    step = side / _N_SAMPLES
    planes = []
    for a, b in ((0, 1), (0, 2), (1, 2)):
        u, v = step * np.eye(3)[a], step * np.eye(3)[b]
        origin = middle - (_N_SAMPLES - 1) / 2 * (u + v)
        i, j = np.indices((_N_SAMPLES, _N_SAMPLES))[..., None]
        values = volume.sample((origin + i * v + j * u).reshape(-1, 3))
        affine = np.column_stack([v, u, origin])
        planes.append(Plane(values.reshape(_N_SAMPLES, _N_SAMPLES), affine))
    return planes


def _zoom(axes: Any, plane: Plane, x: Floats) -> None:
    """Show the surface over the whole beat, with a margin."""
    places = plane.indices(x.reshape(-1, 3))
    margin = _MARGIN / np.array(plane.spacing)
    low = np.maximum(places.min(axis=0) - margin, -0.5)
    high = np.minimum(places.max(axis=0) + margin, np.array(plane.values.shape) - 0.5)
    axes.set_xlim(low[1], high[1])
    axes.set_ylim(high[0], low[0])
