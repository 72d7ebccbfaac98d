"""Pictures of vibration modes on their surface. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import needs_extra
from modalmotion.modes.topology import CLOSED
from modalmotion.numerals import counted, numeral
from modalmotion.pictures.cube import fill_cube
from modalmotion.pictures.view import faces_viewer, size_of, tilted, upright
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
