"""What pictures share: empty figures, plain axes; direction, cube, unit and scale of views."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np

from modalmotion import errors, mesh
from modalmotion.representation import Bools, Floats
from modalmotion.template.template import Template

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Angle of view from above, in radians.
_TILT: Final = 0.2


def new_figure(width: float, height: float, **options: Any) -> Figure:
    """Make an empty figure, of so many inches.

    It has no window and no global state; matplotlib is imported here, as only pictures need it.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    with errors.needs_extra("plot"):
        from matplotlib.figure import Figure

    return Figure(figsize=(width, height), **{"dpi": 120, "layout": "constrained", **options})


def time_axis(times: Floats | None, n_frames: int) -> tuple[Floats, str]:
    """Give the times of frames with the name of their axis, or their numbers."""
    if times is None:
        return np.arange(n_frames, dtype=np.float64), "frame"
    return times, "time (s)"


def lighten(axes: Any, *sides: str, grid: Literal["both", "x", "y"] = "both") -> None:
    """Draw a light grid, and no frame at these sides: top and right by default."""
    axes.grid(axis=grid, alpha=0.25)
    axes.set_axisbelow(True)
    axes.spines[[*(sides or ("top", "right"))]].set_visible(False)


def upright(template: Template) -> Floats:
    """Columns that make the axis upright, its end on top, and theta = 0 in front.

    Returns
    -------
    (3, 3) float64
        Of positions as rows: x to the right, y away from the viewer, z up.
    """
    landmarks = template.landmarks
    closed = () if template.surface is None else template.surface.closed_axes
    if landmarks is None:
        used = np.delete(template.vertices / size_of(template), template.isolated, axis=0)
        _, _, (first, second, third) = np.linalg.svd(used - used.mean(axis=0), full_matrices=False)
        # A torus is horizontal, a sheet is seen along its normal.
        axis, zero = (third, first) if len(closed) == 2 else (second, third)
    elif closed:
        axis, zero = landmarks.axis, landmarks.theta_zero
    else:
        axis, zero = landmarks.theta_zero, landmarks.axis
    return np.stack([np.cross(axis, zero), -zero, axis], axis=1)


def apex_down(reference: Floats) -> Floats:
    """Columns that make the longest axis of points upright, the next one horizontal.

    The wider end is at the top, as ventricles are shown: the apex points down, for any axes of the
    file.
    """
    offsets = reference - reference.mean(axis=0)
    _, _, rows = np.linalg.svd(offsets, full_matrices=False)
    height = offsets @ rows[0]
    widths = np.square(offsets).sum(axis=1) - np.square(height)
    if float(height @ (widths - widths.mean())) < 0.0:
        rows = -rows
    view = np.stack([rows[1], rows[2], rows[0]], axis=1)
    if np.linalg.det(view) < 0:
        view[:, 1] *= -1
    return view


def size_of(template: Template) -> float:
    """Largest coordinate: divisor of positions before drawing."""
    return float(np.abs(template.vertices).max()) or 1.0


def tilted(view: Floats, tilt: float = _TILT) -> Floats:
    """View it slightly from above, by so many radians."""
    c, s = np.cos(tilt), np.sin(tilt)
    turned: Floats = view @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return turned


def faces_viewer(vertices: Floats, template: Template) -> Bools:
    """Triangles whose outside is visible: all of a sheet, which has no outside."""
    faces = mesh.oriented_faces(template.faces, len(vertices))
    if faces is None or not template.topology.closed_axes:
        return np.ones(len(template.faces), dtype=np.bool_)
    normals = mesh.face_normals(vertices, faces)
    centres = vertices[faces].mean(axis=1)
    outward = float(np.einsum("ij,ij->", normals, centres - centres.mean(axis=0)))
    towards: Bools = normals[:, 1] * np.sign(outward) < 0
    return towards


def fill_cube(axes: Any, points: Floats, elevation: float = 0.0, azimuth: float = -90.0) -> None:
    """Set invisible axes of equal scale that the points fill, in a parallel projection.

    Parameters
    ----------
    axes : matplotlib 3D axes
    points : (points, 3) float64
    elevation, azimuth : float
        Of the view, degrees.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    reach, middle = float((high - low).max()) / 2 or 1.0, (low + high) / 2
    axes.set(
        xlim=(middle[0] - reach, middle[0] + reach),
        ylim=(middle[1] - reach, middle[1] + reach),
        zlim=(middle[2] - reach, middle[2] + reach),
    )
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.set_axis_off()
    axes.view_init(elev=elevation, azim=azimuth)
    axes.set_proj_type("ortho")


def drawn_vertices(axes: Any, template: Template, view: Floats) -> Floats:
    """Set axes that a surface fills, and give its vertices in them, which have no unit."""
    used = np.unique(template.faces)
    plain = template.vertices / size_of(template)
    vertices: Floats = (plain - plain[used].mean(axis=0)) @ view
    fill_cube(axes, vertices[used])
    return vertices


_SMALLEST: Final = 1e-9
_LARGEST: Final = 1e9


class ShownUnit(NamedTuple):
    """The unit of a picture's axes.

    Parameters
    ----------
    size : float
        Divisor of lengths before drawing.
    name : str
    """

    size: float
    name: str


def shown_unit(largest: float, unit: str | None) -> ShownUnit:
    """Choose it for the largest length in a picture.

    Parameters
    ----------
    largest : float, `unit`
    unit : str or None
    """
    name = unit or "length units"
    if largest == 0.0 or _SMALLEST <= largest <= _LARGEST:
        return ShownUnit(1.0, name)
    power = math.floor(math.log10(largest))
    return ShownUnit(10.0**power, f"1e{power} {name}")


_INK: Final = "#444a52"
# Of the picture's extent: the longest bar, the arrows, and how far below the surface they are.
_LONGEST: Final = 0.4
_ARROW: Final = 0.1
_BELOW: Final = 0.1

# Letters of the patient's sides that the axes point to, by coordinates.
_LETTERS: Final = {"LPS": ("L", "P", "S"), "RAS": ("R", "A", "S")}


def round_length(longest: float) -> float:
    """Largest of 1, 2 and 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(longest))
    return next(k * power for k in (5.0, 2.0, 1.0) if k * power <= longest * (1 + 1e-12))


def draw_scale(
    axes: Any,
    box: Floats,
    view: Floats,
    *,
    size: float,
    unit: str | None,
    coordinates: str,
    azimuth: float,
) -> None:
    """Draw a scale bar, and the directions of x, y and z, below a surface.

    Parameters
    ----------
    axes : matplotlib 3D axes
        Orthographic, so that the bar is valid everywhere.
    box : (points, 3) float64
        As drawn.
    view : (3, 3) float64
        Positions of the file, as rows, times it are in the axes of the picture.
    size : float
        Length that is drawn as 1.
    unit : str or None
    coordinates : {"LPS", "RAS", "unknown"}
        Of the file: letters of the patient's sides replace x, y and z if they are known.
    azimuth : float
        Of the view, degrees.
    """
    low, high = box.min(axis=0), box.max(axis=0)
    extent, middle = float((high - low).max()), (low + high) / 2
    if not extent > 0:
        return
    angle = math.radians(azimuth)
    right = np.array([-math.sin(angle), math.cos(angle), 0.0])
    down = middle - [0.0, 0.0, (high[2] - low[2]) / 2 + _BELOW * extent]
    shown = shown_unit(extent * size, unit)
    length = round_length(_LONGEST * extent * size / shown.size)
    start = down + 0.05 * extent * right
    end = start + length * shown.size / size * right
    # Below the box of the axes, whose size is unchanged.
    line = {"color": _INK, "clip_on": False, "in_layout": False}
    axes.plot(*zip(start, end, strict=True), lw=2.2, solid_capstyle="butt", **line)
    style = {"color": _INK, "fontsize": 8, "ha": "center", "va": "top", "in_layout": False}
    below = (start + end) / 2 - [0.0, 0.0, 0.025 * extent]
    axes.text(*below, f"{length:g} {shown.name}", **style)
    corner = down - 0.34 * extent * right - [0.0, 0.0, 0.06 * extent]
    for name, direction in zip(_LETTERS.get(coordinates, ("x", "y", "z")), view, strict=True):
        tip = corner + _ARROW * extent * direction
        axes.plot(*zip(corner, tip, strict=True), lw=1.1, **line)
        letter = corner + 1.4 * _ARROW * extent * direction
        axes.text(*letter, name, **{**style, "va": "center"})
