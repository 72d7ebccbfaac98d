"""Natural coordinates of closed surfaces with one handle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import divergence, face_gradients
from modalmotion.modes.topology import TORUS
from modalmotion.numeric.products import along
from modalmotion.progress import ShareReport, part_of, silent
from modalmotion.template.coordinates.axis import (
    Axes,
    axes_about,
    azimuth,
    corner_steps,
    degree,
    n_vortices,
    principal_axes,
    skewness,
    widest_across,
)
from modalmotion.template.coordinates.potential import potential
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.surface import Surface


def torus_axes(surface: Surface, places: dict[str, NDArray[np.float64]]) -> Axes:
    """Find the shortest axis of inertia, towards the stated base, and the widest across it.

    Raises
    ------
    ParameterError
        If a stated landmark gives no direction.
    """
    variances, directions = principal_axes(surface)
    axis = directions[2]
    sense = skewness(surface, axis)
    # A ring has twice the variance across the axis in each direction; 0 for a ball.
    strength = float((variances[1] - variances[2]) / variances[1]) if variances[1] > 0 else 0.0
    if "base" in places:
        sense = 1.0
        if (places["base"] - surface.centroid) @ axis < 0:
            axis = -axis
    strengths = {"axis": strength, "base": sense}
    return axes_about(surface, places, axis, widest_across(surface, axis), strengths)


def torus_coordinates(
    surface: Surface,
    places: dict[str, NDArray[np.float64]],
    axes: Axes,
    report: ShareReport = silent,
) -> Coordinates | None:
    """Angle around the tube and angle around the hole, both smoothed to be harmonic.

    The tube's angle is 0 on the outside and grows towards the axis' end.

    Parameters
    ----------
    surface : Surface
        One closed piece with one handle.
    places : dict of str to (3,) float64
    axes : Axes
        From `torus_axes`.
    report : callable, optional
        Told the share that is done.

    Returns
    -------
    Coordinates or None
        None where the tube does not run once around a straight axis, as on a knot.
    """
    origin, axis = surface.centroid, axes.axis
    offsets = surface.offsets
    height = along(offsets, axis)
    radius = np.linalg.norm(offsets - height[:, None] * axis, axis=1)
    core = float((surface.areas * radius).sum() / surface.area)
    theta = azimuth(offsets, axis, axes.zero)
    tube = np.arctan2(height, radius - core) / (2 * np.pi)
    if n_vortices(theta, surface.faces) or n_vortices(tube, surface.faces):
        return None
    # The two angles must name every place once.
    if not np.isclose(degree(surface, np.stack([tube, theta], axis=1), TORUS), 1.0, atol=1e-6):
        return None
    smooth = [
        _harmonic(surface, angle, part_of(report, k / 2, (k + 1) / 2))
        for k, angle in enumerate((tube, theta))
    ]
    notes = []
    if any(angle is None for angle in smooth):
        notes.append("The triangles are too thin to solve on; the angles are not smoothed.")
    values = np.stack(
        [
            before if after is None else after
            for before, after in zip((tube, theta), smooth, strict=True)
        ],
        axis=1,
    )
    landmarks = Landmarks(
        origin=origin,
        axis=axis,
        theta_zero=axes.zero,
        apex=origin,
        base=places.get("base", origin),
        strengths=axes.strengths,
        n_loops=0,
        given=tuple(places),
    )
    return Coordinates(TORUS, values, landmarks, tuple(notes))


def _harmonic(
    surface: Surface, angle: NDArray[np.float64], report: ShareReport
) -> NDArray[np.float64] | None:
    """Find the smoothest angle that winds as `angle` does, with the same mean."""
    slope = face_gradients(surface.vertices, surface.faces, corner_steps(angle, surface.faces))
    # Laplace f = -div(grad angle): the correction that makes the angle harmonic.
    flux = divergence(surface.vertices, surface.faces, slope)
    added = potential(surface, -flux, np.zeros(0, dtype=np.int64), np.zeros(0), report)
    return None if added is None else angle + added
