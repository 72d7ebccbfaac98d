"""Natural coordinates of cylinders: surfaces with an opening at either end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CYLINDER
from modalmotion.numeric.products import along
from modalmotion.progress import ShareReport, silent
from modalmotion.template.coordinates.axis import (
    Axes,
    axes_about,
    azimuth,
    direction_between,
    lean,
    origin_on,
)
from modalmotion.template.coordinates.potential import potential
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.surface import Opening, Surface


def cylinder_axes(surface: Surface, places: dict[str, NDArray[np.float64]]) -> Axes:
    """Find the axis between the centres of both ends, and the side to which the wall leans.

    Raises
    ------
    ParameterError
        If a stated landmark gives no direction.
    """
    near, far, strength = _ends(surface, places)
    apex, base = places.get("apex", near.centre), places.get("base", far.centre)
    axis = direction_between(surface, apex, base)
    return axes_about(surface, places, axis, lean(surface, axis), {"axis": strength})


def cylinder_coordinates(
    surface: Surface,
    places: dict[str, NDArray[np.float64]],
    axes: Axes,
    report: ShareReport = silent,
) -> Coordinates:
    """Harmonic function between the openings, and azimuth about the axis.

    s is 0 on the shorter opening and 1 on the longer one, unless a landmark says otherwise.

    Parameters
    ----------
    surface : Surface
        One piece with two openings.
    places : dict of str to (3,) float64
    axes : Axes
        From `cylinder_axes`, which decide which end is which.
    report : callable, optional
        Told the share that is done.
    """
    axis = axes.axis
    near, far = sorted(surface.openings, key=lambda opening: float(opening.centre @ axis))
    origin = origin_on(surface, axis, places)
    offsets = surface.vertices - origin
    theta = azimuth(offsets, axis, axes.zero)
    notes: list[str] = []
    held = np.concatenate([near.vertices, far.vertices])
    values = np.repeat([0.0, 1.0], [len(near.vertices), len(far.vertices)])
    s = potential(surface, np.zeros(len(theta)), held, values, report)
    if s is None:
        notes.append("The triangles are too thin to solve on; s is the height along the axis.")
        s = along(offsets, axis)
        s = (s - s.min()) / (np.ptp(s) or 1.0)
    landmarks = Landmarks(
        origin=origin,
        axis=axis,
        theta_zero=axes.zero,
        apex=places.get("apex", near.centre),
        base=places.get("base", far.centre),
        strengths={**axes.strengths, "apex": 1.0, "base": 1.0},
        n_loops=2,
        given=tuple(places),
    )
    return Coordinates(
        CYLINDER, np.stack([np.clip(s, 0.0, 1.0), theta], axis=1), landmarks, tuple(notes)
    )


def _ends(
    surface: Surface, places: dict[str, NDArray[np.float64]]
) -> tuple[Opening, Opening, float]:
    """Return the openings at s = 0 and at s = 1, and how well the shape distinguishes them."""
    far, near = surface.openings
    if "base" in places:
        reference, strength = places["base"], 1.0
    elif "apex" in places:
        reference, strength = near.centre + far.centre - places["apex"], 1.0
    else:
        total = near.length + far.length
        return near, far, (far.length - near.length) / total if total > 0 else 0.0
    if np.linalg.norm(near.centre - reference) < np.linalg.norm(far.centre - reference):
        near, far = far, near
    return near, far, strength
