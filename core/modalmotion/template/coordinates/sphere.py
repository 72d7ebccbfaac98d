"""Natural coordinates of closed surfaces without handles."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import SPHERE
from modalmotion.numeric.products import along, weighted_sum
from modalmotion.progress import ShareReport, silent
from modalmotion.template.coordinates.axis import (
    Axes,
    axes_about,
    azimuth,
    direction_between,
    origin_on,
    principal_axes,
    skewness,
    widest_across,
)
from modalmotion.template.coordinates.potential import potential
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.surface import Surface

# The poles are reported as centroids of caps, weighted by this power of s.
_CAP: Final = 8


def sphere_axes(surface: Surface, places: dict[str, NDArray[np.float64]]) -> Axes:
    """Find the longest axis of inertia towards its blunt end, and the widest direction across it.

    Raises
    ------
    ParameterError
        If a stated landmark gives no direction.
    """
    if {"apex", "base"} & set(places):
        apex = places.get("apex", 2 * surface.centroid - places.get("base", surface.centroid))
        base = places.get("base", 2 * surface.centroid - apex)
        axis, strength, sense = direction_between(surface, apex, base), 1.0, 1.0
    else:
        variances, directions = principal_axes(surface)
        axis = directions[0]
        strength = float((variances[0] - variances[1]) / variances[0])
        sense = skewness(surface, axis)
    strengths = {"axis": strength, "apex": sense, "base": sense}
    return axes_about(surface, places, axis, widest_across(surface, axis), strengths)


def sphere_coordinates(
    surface: Surface,
    places: dict[str, NDArray[np.float64]],
    axes: Axes,
    report: ShareReport = silent,
) -> Coordinates:
    """Angle between the poles of the long axis, and azimuth about it.

    s is 0 at the pointed end. It comes from a potential with the height as its source, which
    on a round sphere is the height itself, and elsewhere is smooth where the height has folds.

    Parameters
    ----------
    surface : Surface
        One closed piece.
    places : dict of str to (3,) float64
    axes : Axes
        From `sphere_axes`.
    report : callable, optional
        Told the share that is done.
    """
    axis = axes.axis
    origin = origin_on(surface, axis, places)
    height = along(surface.offsets, axis)
    theta = azimuth(surface.vertices - origin, axis, axes.zero)
    notes: list[str] = []
    none = np.zeros(0, dtype=np.int64)
    u = potential(surface, surface.areas * height, none, np.zeros(0), report)
    if u is None:
        notes.append("The triangles are too thin to solve on; s is the angle of the height.")
        u = height
    used = np.ones(len(u), dtype=np.bool_)
    used[surface.connectivity.isolated] = False
    low, high = u[used].min(), u[used].max()
    # u is cos(pi s) turned over: its extremes are the poles.
    s = np.arccos(np.clip((high + low - 2 * u) / ((high - low) or 1.0), -1.0, 1.0)) / np.pi
    near, far = (
        weighted_sum(surface.areas * cap, surface.vertices) / float((surface.areas * cap).sum())
        for cap in ((1 - s) ** _CAP, s**_CAP)
    )
    landmarks = Landmarks(
        origin=origin,
        axis=axis,
        theta_zero=axes.zero,
        apex=places.get("apex", near),
        base=places.get("base", far),
        strengths=axes.strengths,
        n_loops=0,
        given=tuple(places),
    )
    return Coordinates(SPHERE, np.stack([s, theta], axis=1), landmarks, tuple(notes))
