"""A picture of natural coordinates on their surface. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError, needs_extra
from modalmotion.modes.topology import CLOSED
from modalmotion.pictures.cube import fill_cube
from modalmotion.pictures.view import faces_viewer, size_of, tilted, upright
from modalmotion.template.coordinates.axis import corner_steps
from modalmotion.template.template import Template

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
