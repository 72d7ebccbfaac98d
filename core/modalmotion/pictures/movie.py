"""A surface that moves, frame by frame as pictures. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import face_normals
from modalmotion.modes.topology import CLOSED_CURVE
from modalmotion.numeric.scales import lengths
from modalmotion.pictures.modes import COLOURS
from modalmotion.pictures.view import fill_cube, new_figure, tilted, upright
from modalmotion.template.template import Template

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_INCHES: Final = 4.8
_DPI: Final = 100
_TILT: Final = 0.45
# A sheet is seen from a corner, where its movement is visible.
_TILT_OF_SHEET: Final = 0.95
_TURN_OF_SHEET: Final = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
# Towards the light, in the view: x to the right, y away from the viewer, z up.
_LIGHT: Final = np.array([-0.48, -0.6, 0.64])


def draw_frames(
    template: Template, positions: Iterable[Array], heights: Iterable[Array], extent: Extent
) -> Iterator[NDArray[np.uint8]]:
    """Draw each frame, coloured by the displacement of its vertices.

    Parameters
    ----------
    template : Template
        Connectivity of the surface, and direction of view.
    positions : iterable of (vertices, 3) float64
    heights : iterable of (vertices,) float64
        Displacement along its direction, signed.
    extent : Extent
        Of all frames.

    Yields
    ------
    (height, width, 3) uint8
    """
    figure = new_figure(_INCHES, _INCHES, dpi=_DPI, layout=None)
    panel: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    for x, height in zip(positions, heights, strict=True):
        panel.clear()
        draw_moved(panel, template, x, height, extent)
        yield pixels_of(figure)


def pixels_of(figure: Figure) -> NDArray[np.uint8]:
    """Draw a figure to pixels, (height, width, 3) uint8."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


class Extent:
    """Extent of all frames: a box in the view, and the largest displacement.

    Parameters
    ----------
    template : Template
    positions : iterable of (vertices, 3) float64
    heights : iterable of (vertices,) float64
    """

    def __init__(
        self, template: Template, positions: Iterable[Array], heights: Iterable[Array]
    ) -> None:
        is_sheet = template.surface is not None and not template.surface.closed_axes
        own = upright(template)
        self.view = tilted(own @ _TURN_OF_SHEET, _TILT_OF_SHEET) if is_sheet else tilted(own, _TILT)
        self.size = float(np.abs(template.vertices).max()) or 1.0
        corners = []
        for x in positions:
            shown = x / self.size @ self.view
            corners += [shown.min(axis=0), shown.max(axis=0)]
        self.box = np.stack([np.min(corners, axis=0), np.max(corners, axis=0)])
        self.largest = max((float(np.abs(h).max()) for h in heights), default=0.0) or 1.0


def draw_moved(panel: Any, template: Template, x: Array, height: Array, extent: Extent) -> None:
    """Draw one frame on 3D axes.

    Parameters
    ----------
    panel : matplotlib 3D axes
    template : Template
    x : (vertices, 3) float64
    height : (vertices,) float64
    extent : Extent
    """
    from matplotlib import colormaps
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    shown = x / extent.size @ extent.view
    fill_cube(panel, extent.box)
    colours = colormaps[COLOURS]
    if len(template.faces):
        values = height[template.faces].mean(axis=1)
        of_faces = colours(0.5 + 0.5 * values / extent.largest)
        normals = face_normals(shown, template.faces)
        steep = np.abs(normals @ _LIGHT) / np.maximum(lengths(normals), 1e-300)
        of_faces[:, :3] *= (0.7 + 0.3 * steep)[:, None]
        drawn: Any = Poly3DCollection(
            shown[template.faces], facecolors=of_faces, edgecolors=of_faces, linewidths=0.3
        )
    else:
        ends = np.roll(shown, -1, axis=0)
        segments = np.stack([shown, ends], axis=1)
        is_ring = template.surface == CLOSED_CURVE
        drawn = Line3DCollection(
            segments if is_ring else segments[:-1],
            colors=colours(0.5 + 0.5 * height / extent.largest),
            linewidths=2.5,
        )
    panel.add_collection3d(drawn)


def write_gif(pictures: Iterable[NDArray[np.uint8]], seconds: float) -> bytes:
    """Write pictures as a GIF that repeats.

    Parameters
    ----------
    pictures : iterable of (height, width, 3) uint8
    seconds : float
        Of each picture; GIF counts in hundredths, and players show at least two.

    Returns
    -------
    bytes
    """
    from PIL import Image

    buffer = io.BytesIO()
    images = (Image.fromarray(picture) for picture in pictures)
    first = next(images)
    duration = 10 * max(2, round(100 * seconds))
    first.save(buffer, format="GIF", save_all=True, append_images=images, duration=duration, loop=0)
    return buffer.getvalue()


def write_png(picture: NDArray[np.uint8]) -> bytes:
    """Write one picture as PNG."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG")
    return buffer.getvalue()
