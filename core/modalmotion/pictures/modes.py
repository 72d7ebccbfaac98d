"""Pictures of modes, of a template's natural coordinates, and of a surface that moves."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.modes.topologies import CLOSED, CLOSED_CURVE
from modalmotion.numeric.scales import lengths
from modalmotion.pictures import views
from modalmotion.representation import Bytes, Floats, counted, numeral
from modalmotion.template.surfaces import corner_steps
from modalmotion.template.template import Template
from modalmotion.template.vibration_modes import VibrationModes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Blue below zero, red above: distinct for colour-blind readers too.
COLOURS: Final = "RdBu_r"

_MOST_PANELS: Final = 24
_MOST_COLUMNS: Final = 7


def modes_figure(template: Template, modes: VibrationModes) -> Figure:
    """Draw the shape of each mode in colour on its surface, with its label and frequency.

    On a curve each shape is a line over the curve's own coordinate.

    Parameters
    ----------
    template : Template
    modes : VibrationModes
        Of that template; the picture shows the first 24.

    Returns
    -------
    matplotlib.figure.Figure
    """
    n = min(len(modes), _MOST_PANELS)
    rows = math.ceil(n / _MOST_COLUMNS)
    columns = math.ceil(n / rows)
    figure = views.new_figure(2.3 * columns + 1.0, 2.6 * rows + 0.7)
    is_surface = len(template.faces) > 0
    largest = float(np.abs(modes.shapes[:, :n]).max())
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(Normalize(-largest, largest), COLOURS)
    panels = []
    for mode in range(n):
        place = (rows, columns, mode + 1)
        panel: Any = figure.add_subplot(*place, projection="3d" if is_surface else None)
        if is_surface:
            draw_shape(panel, template, modes.shapes[:, mode], scale)
        else:
            _draw_line(panel, template, modes.shapes[:, mode], largest)
        frequency = numeral(float(modes.angular_frequencies[mode]))
        panel.set_title(f"{modes.labels[mode]}\n{frequency}", fontsize=9)
        panels.append(panel)
    if is_surface:
        figure.colorbar(scale, ax=panels, shrink=0.8, pad=0.02, label="shape (mean square 1)")
    shown = "" if n == len(modes) else f", the first {n} of {len(modes)}"
    figure.suptitle(
        f"{counted(n, 'mode')} of a {modes.surface}{shown}: label, w in {modes.frequency_unit}",
        fontsize=10,
    )
    return figure


def draw_shape(panel: Any, template: Template, phi: Floats, scale: Any) -> None:
    """Draw one shape in colour on the surface at rest.

    Parameters
    ----------
    panel : matplotlib 3D axes
    template : Template
        Of a surface with triangles.
    phi : (vertices,) float64
    scale : matplotlib ScalarMappable
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    is_sheet = template.surface is not None and not template.surface.closed_axes
    # A sheet is seen along its normal.
    view = views.tilted(views.upright(template), 0.0 if is_sheet else _TILT)
    vertices = views.drawn_vertices(panel, template, view)
    shown = template.faces
    # A tube shows its inside as well, a closed surface only its outside.
    if template.surface is not None and all(e == CLOSED for e in template.surface.ends):
        shown = shown[views.faces_viewer(vertices, template)]
    colours = scale.to_rgba(phi[shown].mean(axis=1))
    panel.add_collection3d(
        Poly3DCollection(vertices[shown], facecolors=colours, edgecolors=colours, linewidths=0.3)
    )


def _draw_line(panel: Any, template: Template, phi: Floats, largest: float) -> None:
    s = template.coordinates[:, 0]
    order = np.argsort(s, kind="stable")
    panel.axhline(0.0, color="#b9bdc1", linewidth=0.8)
    panel.plot(s[order], phi[order], color="#0072B2", marker=".", markersize=3, linewidth=1.0)
    panel.set(xlim=(0.0, 1.0), ylim=(-1.1 * largest, 1.1 * largest))
    panel.tick_params(labelsize=7)


# Bands of colour per unit: tenths of s, twelfths of a turn.
_BANDS: Final = {True: 12, False: 10}


def template_figure(template: Template) -> Figure:
    """Draw each natural coordinate on the surface, from two sides.

    Bands of colour are its tenths, or of angles, whose colours are cyclic, its twelfths. Red marks
    theta = 0, the arrow the axis.

    Parameters
    ----------
    template : Template
        Of a surface with triangles.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TopologyError
        If it has no triangles, or no natural coordinates.
    """
    topology = template.topology
    if not len(template.faces):
        raise errors.TopologyError(
            "There are no triangles to draw the natural coordinates on.",
            remedy="Draw the template of a surface.",
        )
    view = views.upright(template)
    names = _names(topology.n_axes, len(topology.closed_axes))
    figure = views.new_figure(13.0, 3.8)
    for axis in range(topology.n_axes):
        closed = topology.ends[axis] == CLOSED
        scale: Any = None
        panels = []
        for side in (0, 1):
            panel: Any = figure.add_subplot(1, 4, 2 * axis + side + 1, projection="3d")
            turn = np.diag([-1.0, -1.0, 1.0]) if side else np.eye(3)
            scale = _draw(panel, template, axis, closed, views.tilted(view @ turn))
            panel.set_title(f"{names[axis]}, {('front', 'back')[side]}", fontsize=10)
            panels.append(panel)
        label = f"{names[axis]} (turns)" if closed else names[axis]
        figure.colorbar(scale, ax=panels, shrink=0.7, pad=0.02, label=label)
    figure.suptitle(_title(template), fontsize=11)
    return figure


def _names(n_axes: int, n_closed: int) -> tuple[str, ...]:
    if n_closed == 1:
        return ("s", "theta")
    return ("tube angle", "theta") if n_closed else ("s", "t")[:n_axes]


def _title(template: Template) -> str:
    lengths = " x ".join(f"{length:.3g}" for length in template.lengths)
    text = f"{template.topology.name}: {template.n_vertices} vertices, {lengths}"
    if template.landmarks is not None:
        strengths = ", ".join(f"{k} {v:.2f}" for k, v in template.landmarks.strengths.items())
        text += f"; how well determined: {strengths}"
    return text


def _draw(panel: Any, template: Template, axis: int, closed: bool, view: Floats) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, to_rgba
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    vertices = views.drawn_vertices(panel, template, view)
    # Triangles that face away are not drawn.
    ahead = views.faces_viewer(vertices, template)
    faces, column = template.faces[ahead], template.coordinates[:, axis]
    # An angle has no jump inside a triangle.
    steps = corner_steps(column, faces) if closed else column[faces] - column[faces][:, :1]
    corners = column[faces][:, :1] + steps
    n = _BANDS[closed]
    scale = ScalarMappable(
        BoundaryNorm(np.linspace(0.0, 1.0, n + 1), 256), "twilight" if closed else "viridis"
    )
    values = corners.mean(axis=1)
    colours = scale.to_rgba(values % 1.0 if closed else values)
    if closed:
        least, most = np.floor(corners.min(axis=1)), np.floor(corners.max(axis=1))
        colours[least < most] = to_rgba("#d62728")
    panel.add_collection3d(
        Poly3DCollection(vertices[faces], facecolors=colours, edgecolors=colours, linewidths=0.3)
    )
    if template.landmarks is not None and template.topology.closed_axes:
        panel.computed_zorder = False
        used = np.unique(template.faces)
        plain = template.landmarks.origin / views.size_of(template)
        origin = (plain - (template.vertices[used] / views.size_of(template)).mean(axis=0)) @ view
        reach = 1.2 * (vertices[used, 2].max() - origin[2])
        tip = origin + reach * (template.landmarks.axis @ view)
        panel.plot(*np.stack([origin, tip], axis=1), color="black", linewidth=1.2, zorder=0)
    return scale


_INCHES: Final = 4.8
_DPI: Final = 100
_TILT: Final = 0.45
# A sheet is seen from a corner, where its movement is visible.
_TILT_OF_SHEET: Final = 0.95
_TURN_OF_SHEET: Final = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
# Towards the light, in the view: x to the right, y away from the viewer, z up.
_LIGHT: Final = np.array([-0.48, -0.6, 0.64])


def draw_frames(
    template: Template, positions: Iterable[Floats], heights: Iterable[Floats], extent: Extent
) -> Iterator[Bytes]:
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
    figure = views.new_figure(_INCHES, _INCHES, dpi=_DPI, layout=None)
    panel: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    for x, height in zip(positions, heights, strict=True):
        panel.clear()
        draw_moved(panel, template, x, height, extent)
        yield pixels_of(figure)


def pixels_of(figure: Figure) -> Bytes:
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
        self, template: Template, positions: Iterable[Floats], heights: Iterable[Floats]
    ) -> None:
        is_sheet = template.surface is not None and not template.surface.closed_axes
        own = views.upright(template)
        self.view = (
            views.tilted(own @ _TURN_OF_SHEET, _TILT_OF_SHEET)
            if is_sheet
            else views.tilted(own, _TILT)
        )
        self.size = views.size_of(template)
        corners = []
        for x in positions:
            shown = x / self.size @ self.view
            corners += [shown.min(axis=0), shown.max(axis=0)]
        self.box = np.stack([np.min(corners, axis=0), np.max(corners, axis=0)])
        self.largest = max((float(np.abs(h).max()) for h in heights), default=0.0) or 1.0


def draw_moved(panel: Any, template: Template, x: Floats, height: Floats, extent: Extent) -> None:
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
    views.fill_cube(panel, extent.box)
    colours = colormaps[COLOURS]
    if len(template.faces):
        values = height[template.faces].mean(axis=1)
        of_faces = colours(0.5 + 0.5 * values / extent.largest)
        normals = mesh.face_normals(shown, template.faces)
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


def write_gif(pictures: Iterable[Bytes], seconds: float) -> bytes:
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
