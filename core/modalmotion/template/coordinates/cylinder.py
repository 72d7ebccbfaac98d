"""Natural coordinates of cylinders: surfaces with an opening at either end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CYLINDER
from modalmotion.numeric.products import along
from modalmotion.progress import ShareReport, silent
from modalmotion.template.coordinates.axis import axis_between, azimuth, lean, theta_zero
from modalmotion.template.coordinates.potential import potential
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.surface import Opening, Surface


def cylinder_coordinates(
    surface: Surface, places: dict[str, NDArray[np.float64]], report: ShareReport = silent
) -> Coordinates:
    """Harmonic function between the openings, and azimuth about the axis.

    s is 0 on the shorter opening and 1 on the longer one, unless a landmark says otherwise.

    Parameters
    ----------
    surface : Surface
        One piece with two openings.
    places : dict of str to (3,) float64
    report : callable, optional
        Told the share that is done.

    Raises
    ------
    ParameterError
        If a stated landmark gives no direction.
    """
    near, far, strength = _ends(surface, places)
    apex, base = places.get("apex", near.centre), places.get("base", far.centre)
    origin, axis = axis_between(surface, apex, base)
    if not {"apex", "base"} & set(places):
        origin = surface.centroid
    zero, zero_strength = theta_zero(surface, places, origin, axis, lean)
    offsets = surface.vertices - origin
    theta = azimuth(offsets, axis, zero)
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
        theta_zero=zero,
        apex=apex,
        base=base,
        strengths={
            "axis": strength,
            "apex": 1.0,
            "base": 1.0,
            "theta_zero": zero_strength,
        },
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
