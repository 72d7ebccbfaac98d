"""Natural coordinates of sheets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.modes.topology import PLANE
from modalmotion.numeric.products import along
from modalmotion.progress import ShareReport, part_of, silent
from modalmotion.template.coordinates.axis import Axes, principal_axes, skewness
from modalmotion.template.coordinates.potential import potential
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.surface import Surface


def plane_axes(surface: Surface, places: dict[str, NDArray[np.float64]]) -> Axes:
    """Find the normal, and the longest axis of inertia or the side between stated corners."""
    variances, directions = principal_axes(surface)
    long = directions[0]
    # The sense of the normal follows from the other two, so that all three are right-handed.
    normal = np.cross(long, directions[1])
    gap = float((variances[0] - variances[1]) / variances[0]) if variances[0] > 0 else 0.0
    start = min(skewness(surface, directions[0]), skewness(surface, directions[1]))
    flatness = 1 - float(np.sqrt(variances[2] / variances[1])) if variances[1] > 0 else 0.0
    if "corners" in places:
        origin, right, opposite, left = places["corners"]
        long = right + opposite - origin - left
        long = long - (long @ normal) * normal
        long /= np.linalg.norm(long)
        gap = start = 1.0
    return Axes(normal, long, {"axis": flatness, "theta_zero": gap, "start": start})


def plane_coordinates(
    surface: Surface,
    places: dict[str, NDArray[np.float64]],
    axes: Axes,
    report: ShareReport = silent,
) -> Coordinates:
    """Place along the longer and the shorter axis of inertia, or between four stated corners.

    Without corners the sheet is taken for the rectangle that has its second moments, whose
    sides are sqrt(12) standard deviations long. Where the sheet reaches beyond that
    rectangle, so do the coordinates; the shapes go on there as mirror images.

    Parameters
    ----------
    surface : Surface
        One piece with one opening: its rim.
    places : dict of str to (4, 3) float64
    axes : Axes
        From `plane_axes`.
    report : callable, optional
        Told the share that is done.

    Raises
    ------
    ParameterError
        If the corners do not follow one another along the rim.
    """
    notes: list[str] = []
    values = None
    if "corners" in places:
        corners = _rim_positions(surface, places["corners"])
        values = _between_corners(surface, corners, report)
        if values is None:
            notes.append("The triangles are too thin to solve on; the corners were not used.")
    if values is None:
        columns = []
        for direction in axes.matrix.T[:2]:
            side = np.sqrt(12 * max(float(direction @ surface.covariance @ direction), 0.0))
            columns.append(0.5 + along(surface.offsets, direction) / (side or 1.0))
        values = np.stack(columns, axis=1)
    landmarks = Landmarks(
        origin=surface.centroid,
        axis=axes.axis,
        theta_zero=axes.zero,
        apex=surface.centroid,
        base=surface.centroid,
        strengths=axes.strengths,
        n_loops=len(surface.openings),
        given=tuple(places),
    )
    return Coordinates(PLANE, values, landmarks, tuple(notes))


def _rim_positions(surface: Surface, corners: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Rim vertices on each of the four sides, both corners included."""
    rim = _in_order(surface.connectivity.loops[0])
    places = surface.vertices[rim]
    nearest = [int(np.argmin(np.linalg.norm(places - corner, axis=1))) for corner in corners]
    turned = [(k - nearest[0]) % len(rim) for k in nearest]
    if turned[1] > turned[3]:
        rim = np.roll(rim[::-1], 1)
        turned = [(-k) % len(rim) for k in turned]
        first = (-nearest[0]) % len(rim)
    else:
        first = nearest[0]
    if not turned[0] < turned[1] < turned[2] < turned[3]:
        raise ParameterError(
            "The four corners do not follow one another along the rim.",
            remedy="Give the corners at (s, t) = (0, 0), (1, 0), (1, 1), (0, 1), in the order in "
            "which they lie on the rim.",
        )
    rim = np.roll(rim, -first)
    ends = [*turned, len(rim)]
    return [np.take(rim, np.arange(ends[i], ends[i + 1] + 1), mode="wrap") for i in range(4)]


def _between_corners(
    surface: Surface, sides: list[NDArray[np.int64]], report: ShareReport
) -> NDArray[np.float64] | None:
    # Sides in order: t = 0, s = 1, t = 1, s = 0. Each coordinate is harmonic between two.
    columns = []
    for k, (low, high) in enumerate(((sides[3], sides[1]), (sides[0], sides[2]))):
        half = part_of(report, k / 2, (k + 1) / 2)
        held = np.concatenate([low, high])
        values = np.repeat([0.0, 1.0], [len(low), len(high)])
        column = potential(surface, np.zeros(len(surface.vertices)), held, values, half)
        if column is None:
            return None
        columns.append(column)
    return np.clip(np.stack(columns, axis=1), 0.0, 1.0)


def _in_order(loop: NDArray[np.int64]) -> NDArray[np.int64]:
    """Vertices of a closed loop of edges, one after the other."""
    neighbours: dict[int, list[int]] = {}
    for a, b in loop.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    start = int(loop.min())
    order, before, here = [start], -1, start
    while True:
        one, other = neighbours[here][:2]
        ahead = other if one == before else one
        if ahead == start or len(order) > len(loop):
            break
        order.append(ahead)
        before, here = here, ahead
    return np.array(order)
