"""Pictures of modes and of a template's natural coordinates."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError, needs_extra
from modalmotion.modes.topology import CLOSED
from modalmotion.pictures.view import faces_viewer, fill_cube, size_of, tilted, upright
from modalmotion.representation import counted, numeral
from modalmotion.template.axis import corner_steps
from modalmotion.template.template import Template
from modalmotion.template.vibration_modes import VibrationModes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Blue below zero, red above: distinct for colour-blind readers too.
COLOURS: Final = "RdBu_r"

_MOST_PANELS: Final = 24
_MOST_COLUMNS: Final = 7
_TILT: Final = 0.45


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
    # Imported here because only pictures need it. A bare Figure has no window or global state.
    with needs_extra("plot"):
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize
        from matplotlib.figure import Figure

    n = min(len(modes), _MOST_PANELS)
    rows = math.ceil(n / _MOST_COLUMNS)
    columns = math.ceil(n / rows)
    figure = Figure(figsize=(2.3 * columns + 1.0, 2.6 * rows + 0.7), dpi=120, layout="constrained")
    is_surface = len(template.faces) > 0
    largest = float(np.abs(modes.shapes[:, :n]).max())
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


def draw_shape(
    panel: Any, template: Template, phi: NDArray[np.float64], scale: Any, tilt: float | None = None
) -> None:
    """Draw one shape in colour on the surface at rest.

    Parameters
    ----------
    panel : matplotlib 3D axes
    template : Template
        Of a surface with triangles.
    phi : (vertices,) float64
    scale : matplotlib ScalarMappable
    tilt : float, optional, rad
        Angle of view from above; a sheet is seen along its normal by default.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    is_sheet = template.surface is not None and not template.surface.closed_axes
    view = tilted(upright(template), (0.0 if is_sheet else _TILT) if tilt is None else tilt)
    used = np.unique(template.faces)
    size = size_of(template)
    vertices = (template.vertices / size - (template.vertices[used] / size).mean(axis=0)) @ view
    fill_cube(panel, vertices[used])
    panel.view_init(elev=0, azim=-90)
    panel.set_proj_type("ortho")
    shown = template.faces
    # A tube shows its inside as well, a closed surface only its outside.
    if template.surface is not None and all(e == CLOSED for e in template.surface.ends):
        shown = shown[faces_viewer(vertices, template)]
    colours = scale.to_rgba(phi[shown].mean(axis=1))
    panel.add_collection3d(
        Poly3DCollection(vertices[shown], facecolors=colours, edgecolors=colours, linewidths=0.3)
    )


def _draw_line(panel: Any, template: Template, phi: NDArray[np.float64], largest: float) -> None:
    s = template.coordinates[:, 0]
    order = np.argsort(s, kind="stable")
    panel.axhline(0.0, color="#b9bdc1", linewidth=0.8)
    panel.plot(s[order], phi[order], color="#0072B2", marker=".", markersize=3, linewidth=1.0)
    panel.set(xlim=(0.0, 1.0), ylim=(-1.1 * largest, 1.1 * largest))
    panel.tick_params(labelsize=7)


# Lines of equal coordinate per unit: tenths of s, twelfths of a turn.
_LINES = {True: 12, False: 10}


def template_figure(template: Template) -> Figure:
    """Draw each natural coordinate on the surface, from two sides.

    Colours show the coordinate, cyclic ones for angles; dark lines its tenths or twelfths. Red
    marks theta = 0, the arrow the axis.

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
    # Imported here because only pictures need it. A bare Figure has no window or global state.
    with needs_extra("plot"):
        from matplotlib.figure import Figure

    topology = template.topology
    if not len(template.faces):
        raise TopologyError(
            "There are no triangles to draw the natural coordinates on.",
            remedy="Draw the template of a surface.",
        )
    view = upright(template)
    names = _names(topology.n_axes, len(topology.closed_axes))
    figure = Figure(figsize=(13.0, 3.8), dpi=120, layout="constrained")
    for axis in range(topology.n_axes):
        closed = topology.ends[axis] == CLOSED
        scale: Any = None
        panels = []
        for side in (0, 1):
            panel: Any = figure.add_subplot(1, 4, 2 * axis + side + 1, projection="3d")
            turn = np.diag([-1.0, -1.0, 1.0]) if side else np.eye(3)
            scale = _draw(panel, template, axis, closed, tilted(view @ turn))
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


def _draw(
    panel: Any, template: Template, axis: int, closed: bool, view: NDArray[np.float64]
) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    used = np.unique(template.faces)
    # The picture has no axes, so its unit is arbitrary.
    size = size_of(template)
    centre = (template.vertices[used] / size).mean(axis=0)
    vertices = (template.vertices / size - centre) @ view
    fill_cube(panel, vertices[used])
    panel.view_init(elev=0, azim=-90)
    panel.set_proj_type("ortho")
    # Lines are on the triangles; Matplotlib would sort them behind.
    panel.computed_zorder = False
    # Triangles that face away are not drawn, because lines would show through them.
    values = _corners(template, axis, closed)
    corners = vertices[template.faces]
    ahead = faces_viewer(vertices, template)
    scale = ScalarMappable(Normalize(0.0, 1.0), "twilight" if closed else "viridis")
    shown = values[ahead].mean(axis=1)
    colours = scale.to_rgba(shown % 1.0 if closed else shown)
    panel.add_collection3d(
        Poly3DCollection(
            corners[ahead], facecolors=colours, edgecolors=colours, linewidths=0.3, zorder=1
        )
    )
    for colour, segments in _lines(corners[ahead], values[ahead], closed):
        panel.add_collection3d(Line3DCollection(segments, colors=colour, linewidths=0.9, zorder=2))
    if template.landmarks is not None and template.topology.closed_axes:
        origin = (template.landmarks.origin / size - centre) @ view
        reach = 1.2 * (vertices[used, 2].max() - origin[2])
        tip = origin + reach * (template.landmarks.axis @ view)
        panel.plot(*np.stack([origin, tip], axis=1), color="black", linewidth=1.2, zorder=0)
    return scale


def _corners(template: Template, axis: int, closed: bool) -> NDArray[np.float64]:
    """Coordinate at the corners of each triangle, angles without a jump inside."""
    column = template.coordinates[:, axis]
    if not closed:
        return column[template.faces]
    return column[template.faces][:, :1] + corner_steps(column, template.faces)


def _lines(
    corners: NDArray[np.float64], values: NDArray[np.float64], closed: bool
) -> list[tuple[str, NDArray[np.float64]]]:
    """Segments of triangles at whole multiples of the coordinate's step."""
    n = _LINES[closed]
    scaled = values * n
    segments: dict[bool, list[NDArray[np.float64]]] = {True: [], False: []}
    first, last = int(np.floor(scaled.min())), int(np.ceil(scaled.max()))
    for level in range(first, last + 1):
        ends = []
        for k in range(3):
            a, b = scaled[:, k] - level, scaled[:, (k + 1) % 3] - level
            crosses = (a < 0) != (b < 0)
            share = np.where(crosses, a / np.where(crosses, a - b, 1.0), np.nan)[:, None]
            ends.append(corners[:, k] + share * (corners[:, (k + 1) % 3] - corners[:, k]))
        points = np.stack(ends, axis=1)
        inside = np.isfinite(points[:, :, 0])
        cut = inside.sum(axis=1) == 2
        is_zero = closed and level % n == 0
        segments[is_zero].append(points[cut][inside[cut]].reshape(-1, 2, 3))
    return [
        (colour, np.concatenate(segments[kind]))
        for kind, colour in ((False, "#222222"), (True, "#d62728"))
        if sum(map(len, segments[kind]))
    ]
