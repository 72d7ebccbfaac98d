"""Contours of a tracked surface over the images that it was tracked through."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import needs_extra
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.images.sequence import Image
from modalmotion.mesh.plane_section import Edges
from modalmotion.pictures.movie import write_gif
from modalmotion.tracking.result import Track

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    with needs_extra("plot"):
        from matplotlib.figure import Figure

    overlay = _Overlay(track, images.sliced())
    frames = np.unique(np.linspace(0, track.n_frames - 1, _N_PHASES).round().astype(np.int64))
    rows, columns = overlay.n_planes, len(frames)
    figure = Figure(figsize=(2.0 * columns, 2.0 * rows), dpi=120, layout="constrained")
    for column, k in enumerate(frames.tolist()):
        places = [row * columns + column + 1 for row in range(rows)]
        overlay.draw(k, [figure.add_subplot(rows, columns, place) for place in places])
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
    with needs_extra("plot"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    overlay = _Overlay(track, images.sliced())
    n = overlay.n_planes

    def drawn(k: int) -> NDArray[np.uint8]:
        figure = Figure(figsize=(2.4 * n, 2.6), dpi=100, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        overlay.draw(k, [figure.add_subplot(1, n, place) for place in range(1, n + 1)])
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    times = track.sequence.times
    step = 1.0 / track.n_frames if times is None or len(times) < 2 else float(np.diff(times).mean())
    return write_gif(map(drawn, range(track.n_frames)), step)


class _Overlay:
    """Contours of a track over sliced images: what all frames share.

    Parameters
    ----------
    track : Track
    images : ImageSequence
    """

    def __init__(self, track: Track, images: ImageSequence) -> None:
        self._images = images
        self._x = track.sequence.vertices.astype(np.float64)
        self._edges = Edges.of(track.template.faces)
        self._shifts = () if track.images is None else track.images.shifts
        first = next(frame for frame in images.frames if frame is not None)
        self.n_planes = min(_N_PLANES, len(_planes(first, self._x)))

    def draw(self, k: int, all_axes: Sequence[Any]) -> None:
        """Draw the planes of a frame, each into its axes; a missing frame is empty."""
        image = self._images.frames[k]
        chosen = [] if image is None else _planes(image, self._x)
        all_axes[0].set_title(f"frame {k}", fontsize=8)
        for axes in all_axes:
            axes.set_axis_off()
        for axes, (number, plane) in zip(all_axes, chosen, strict=False):
            low, high = np.nanpercentile(plane.values.astype(np.float64), (1, 99.5))
            axes.imshow(plane.values, cmap="gray", vmin=low, vmax=high)
            shift = np.array(self._shifts[number]) if self._shifts else np.zeros(3)
            for segment in contours_in(plane, self._x[k], self._edges, shift):
                axes.plot(segment[:, 1], segment[:, 0], color=_CONTOUR, linewidth=0.8)
            _zoom(axes, plane, self._x)


def contours_in(
    plane: Plane, x: NDArray[np.float64], edges: Edges, shift: NDArray[np.float64]
) -> NDArray[np.float64]:
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


def _planes(image: Image, x: NDArray[np.float64]) -> list[tuple[int, Plane]]:
    """Choose planes to show, with their numbers; of a volume three through the surface's centre."""
    if isinstance(image, PlaneSet):
        numbers = np.unique(np.linspace(0, len(image) - 1, _N_PLANES).round().astype(np.int64))
        return [(k, image.planes[k]) for k in numbers.tolist()]
    return [(0, plane) for plane in _cuts(image, x)]


def _cuts(volume: Volume, x: NDArray[np.float64]) -> list[Plane]:
    everywhere = x.reshape(-1, 3)
    middle = everywhere.mean(axis=0)
    side = float(np.ptp(everywhere, axis=0).max()) + 2.0 * _MARGIN
    step = side / _N_SAMPLES
    planes = []
    for a, b in ((0, 1), (0, 2), (1, 2)):
        u, v = step * np.eye(3)[a], step * np.eye(3)[b]
        origin = middle - (_N_SAMPLES - 1) / 2 * (u + v)
        i, j = np.meshgrid(np.arange(_N_SAMPLES), np.arange(_N_SAMPLES), indexing="ij")
        points = origin + i[..., None] * v + j[..., None] * u
        values = volume.sample(points.reshape(-1, 3)).reshape(i.shape)
        planes.append(Plane(values, np.column_stack([v, u, origin])))
    return planes


def _zoom(axes: Any, plane: Plane, x: NDArray[np.float64]) -> None:
    """Show the surface over the whole beat, with a margin."""
    places = plane.indices(x.reshape(-1, 3))
    margin = _MARGIN / np.array(plane.spacing)
    low = np.maximum(places.min(axis=0) - margin, -0.5)
    high = np.minimum(places.max(axis=0) + margin, np.array(plane.values.shape) - 0.5)
    axes.set_xlim(low[1], high[1])
    axes.set_ylim(high[0], low[0])
