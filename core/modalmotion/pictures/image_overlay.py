"""Contours of a tracked surface over the images that it was tracked through."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import needs_extra
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.images.sequence import Image
from modalmotion.mesh.plane_section import Edges
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

    images = images.sliced()
    frames = np.unique(np.linspace(0, track.n_frames - 1, _N_PHASES).round().astype(np.int64))
    x = track.sequence.vertices.astype(np.float64)
    edges = Edges.of(track.template.faces)
    rows = min(_N_PLANES, len(_planes(next(f for f in images.frames if f is not None), x)))
    figure = Figure(figsize=(2.0 * len(frames), 2.0 * rows), dpi=120, layout="constrained")
    shifts = () if track.images is None else track.images.shifts
    for column, k in enumerate(frames.tolist()):
        image = images.frames[k]
        chosen = [] if image is None else _planes(image, x)
        for row in range(rows):
            axes: Any = figure.add_subplot(rows, len(frames), row * len(frames) + column + 1)
            axes.set_axis_off()
            if row == 0:
                axes.set_title(f"frame {k}", fontsize=8)
            if row >= len(chosen):
                continue
            number, plane = chosen[row]
            low, high = np.nanpercentile(plane.values.astype(np.float64), (1, 99.5))
            axes.imshow(plane.values, cmap="gray", vmin=low, vmax=high)
            shift = np.array(shifts[number]) if shifts else np.zeros(3)
            for segment in contours_in(plane, x[k], edges, shift):
                axes.plot(segment[:, 1], segment[:, 0], color=_CONTOUR, linewidth=0.8)
            _zoom(axes, plane, x)
    return figure


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
        By which the plane shows everything aside.

    Returns
    -------
    (segments, 2, 2) float64
        Ends of each segment, in indices of the plane.
    """
    cut = edges.cut(x, plane.heights(x))
    places = (cut.shares[:, :, None] * x[cut.corners]).sum(axis=1) + shift
    return plane.indices(places)[cut.segments]


def _planes(image: Image, x: NDArray[np.float64]) -> list[tuple[int, Plane]]:
    """Choose planes to show, with their numbers; of a volume three through the surface's middle."""
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
