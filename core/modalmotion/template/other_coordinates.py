"""Natural coordinates of planes, tori and curves."""

from typing import Final

import numpy as np
import scipy

from modalmotion.errors import ParameterError
from modalmotion.mesh.triangles import curve_weights, step_lengths
from modalmotion.modes.topologies import CLOSED_CURVE, PLANE, TORUS, Topology
from modalmotion.notes import Note
from modalmotion.progress import Reporter, part_of, silent
from modalmotion.representation import Floats, Ints
from modalmotion.template.axis import (
    Axes,
    any_across,
    axes_about,
    azimuth,
    degree,
    landmarks_at,
    n_vortices,
    potential,
    principal_axes,
    skewness,
    towards,
    widest_across,
)
from modalmotion.template.landmarks import Coordinates, Landmarks
from modalmotion.template.surfaces import Surface


def plane_axes(surface: Surface, places: dict[str, Floats]) -> Axes:
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
    surface: Surface, places: dict[str, Floats], axes: Axes, report: Reporter = silent
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
    notes: list[Note] = []
    values = None
    if "corners" in places:
        corners = _rim_positions(surface, places["corners"])
        values = _between_corners(surface, corners, report)
        if values is None:
            notes.append(Note.of("corners_unused"))
    if values is None:
        columns = []
        for direction in axes.matrix.T[:2]:
            side = np.sqrt(12 * max(float(direction @ surface.covariance @ direction), 0.0))
            columns.append(0.5 + (surface.offsets @ direction) / (side or 1.0))
        values = np.stack(columns, axis=1)
    middle = surface.centroid
    landmarks = landmarks_at(surface, places, axes, middle, middle, middle)
    return Coordinates(PLANE, values, landmarks, tuple(notes))


def _rim_positions(surface: Surface, corners: Floats) -> list[Ints]:
    """Rim vertices on each of the four sides, both corners included."""
    rim = _in_order(surface.connectivity.loops[0])
    places = surface.vertices[rim]
    nearest = [int(np.argmin(np.linalg.norm(places - corner, axis=1))) for corner in corners]
    turned = [(k - nearest[0]) % len(rim) for k in nearest]
    first = nearest[0]
    if turned[1] > turned[3]:
        rim = np.roll(rim[::-1], 1)
        turned = [(-k) % len(rim) for k in turned]
        first = (-first) % len(rim)
    if not turned[0] < turned[1] < turned[2] < turned[3]:
        raise ParameterError(
            "The four corners are not in their order along the rim.",
            remedy="Give the corners at (s, t) = (0, 0), (1, 0), (1, 1), (0, 1), in their order "
            "along the rim.",
        )
    rim = np.roll(rim, -first)
    ends = [*turned, len(rim)]
    return [np.take(rim, np.arange(ends[i], ends[i + 1] + 1), mode="wrap") for i in range(4)]


def _between_corners(surface: Surface, sides: list[Ints], report: Reporter) -> Floats | None:
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


def _in_order(loop: Ints) -> Ints:
    """Vertices of a closed loop of edges, one after the other."""
    n = int(loop.max()) + 1
    graph = scipy.sparse.csr_array((np.ones(len(loop)), loop.T), shape=(n, n))
    return np.asarray(
        scipy.sparse.csgraph.depth_first_order(
            graph, loop.min(), directed=False, return_predecessors=False
        )
    )


def torus_axes(surface: Surface, places: dict[str, Floats]) -> Axes:
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
    surface: Surface, places: dict[str, Floats], axes: Axes, _: Reporter = silent
) -> Coordinates | None:
    """Angle around the tube and angle around the hole.

    The tube's angle is 0 on the outside and grows towards the axis' end.

    Parameters
    ----------
    surface : Surface
        One closed piece with one handle.
    places : dict of str to (3,) float64
    axes : Axes
        From `torus_axes`.

    Returns
    -------
    Coordinates or None
        None if the tube does not run once around a straight axis, as on a knot.
    """
    origin, axis = surface.centroid, axes.axis
    offsets = surface.offsets
    height = offsets @ axis
    radius = np.linalg.norm(offsets - height[:, None] * axis, axis=1)
    core = float((surface.areas * radius).sum() / surface.area)
    theta = azimuth(offsets, axis, axes.zero)
    tube = np.arctan2(height, radius - core) / (2 * np.pi)
    if n_vortices(theta, surface.faces) or n_vortices(tube, surface.faces):
        return None
    # The two angles must name every place once.
    values = np.stack([tube, theta], axis=1)
    if not np.isclose(degree(surface, values, TORUS), 1.0, atol=1e-6):
        return None
    landmarks = landmarks_at(surface, places, axes, origin, origin, origin)
    return Coordinates(TORUS, values, landmarks)


OTHERS: Final = {PLANE: (plane_axes, plane_coordinates), TORUS: (torus_axes, torus_coordinates)}
"""Axes and coordinates by topology."""


def curve_coordinates(
    vertices: Floats, topology: Topology, places: dict[str, Floats]
) -> Coordinates:
    """Arc length of the reference from the first vertex on, as a share of the whole.

    Arc length and not the count of vertices, so that the same contour drawn with other
    vertices has the same modes.

    Parameters
    ----------
    vertices : (vertices, 3) float64
    topology : Topology
        Open or closed curve.
    places : dict of str to (3,) float64

    Raises
    ------
    ParameterError
        If the stated start is on the curve's own axis.
    """
    closed = topology == CLOSED_CURVE
    steps = step_lengths(vertices, topology)
    total = float(steps.sum())
    reached = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    notes: list[Note] = []
    if not total > 0:
        notes.append(Note.of("curve_without_length"))
        n = len(vertices)
        values = np.arange(n) / (n if closed else max(n - 1, 1))
        total_or_one = 1.0
    else:
        values, total_or_one = reached / total, total
        if not closed:
            # Rounding of the sum must not push the end beyond 1.
            values = np.append(reached, total)[: len(vertices)] / total
    weights = curve_weights(vertices, topology)
    centre = (weights @ vertices) / (weights.sum() or 1.0)
    axis, strength, zero, zero_strength = (
        _closed(vertices, centre, total_or_one, places.get("theta_zero"))
        if closed
        else _open(vertices, centre, total_or_one)
    )
    landmarks = Landmarks(
        origin=centre,
        axis=axis,
        theta_zero=zero,
        apex=centre if closed else vertices[0],
        base=centre if closed else vertices[-1],
        strengths={"axis": strength, "theta_zero": zero_strength},
        n_loops=0,
        given=tuple(places),
    )
    if closed and "theta_zero" in places:
        values = values - _nearest(vertices, steps, places["theta_zero"]) / total_or_one
    return Coordinates(topology, values[:, None], landmarks, tuple(notes))


def _nearest(vertices: Floats, steps: Floats, place: Floats) -> float:
    """Length along a closed curve at which it comes nearest to a place."""
    sides = np.roll(vertices, -1, axis=0) - vertices
    reach = np.einsum("ij,ij->i", place - vertices, sides) / np.where(steps > 0, steps**2, 1.0)
    share = np.clip(reach, 0.0, 1.0)
    gaps = np.linalg.norm(vertices + share[:, None] * sides - place, axis=1)
    k = int(np.argmin(gaps))
    return float(steps[:k].sum() + share[k] * steps[k])


_Axes = tuple[Floats, float, Floats, float]
"""The axis and theta_zero of a curve, each with its strength."""


def _closed(vertices: Floats, centre: Floats, length: float, stated: Floats | None) -> _Axes:
    # The axis is the area vector: half the integral of x times dx.
    offsets = vertices - centre
    area = 0.5 * np.cross(offsets, np.roll(offsets, -1, axis=0)).sum(axis=0)
    size = float(np.linalg.norm(area))
    # Of all curves of one length the circle has the largest area, L^2 / 4 pi.
    strength = min(1.0, size * 4 * np.pi / length**2)
    if not strength > 1e-9:
        axis = np.array([0.0, 0.0, 1.0])
        return axis, 0.0, any_across(axis), 0.0
    axis = area / size
    # The sender decides which vertex is first.
    start = vertices[0] if stated is None else stated
    across = start - centre - ((start - centre) @ axis) * axis
    if stated is None and not float(np.linalg.norm(across)) > 1e-6 * length:
        return axis, strength, any_across(axis), 1.0
    return axis, strength, towards(start, centre, axis, length), 1.0


def _open(vertices: Floats, centre: Floats, length: float) -> _Axes:
    # The axis is the chord; theta_zero points to the side on which the curve bulges.
    chord = vertices[-1] - vertices[0]
    reach = float(np.linalg.norm(chord))
    strength = min(1.0, reach / length)
    if strength > 1e-9:
        axis = chord / reach
    else:
        offsets = vertices - centre
        axis, strength = np.linalg.eigh(offsets.T @ offsets)[1][:, 2], 0.0
    bulge = centre - (vertices[0] + vertices[-1]) / 2
    bulge = bulge - (bulge @ axis) * axis
    height = float(np.linalg.norm(bulge))
    if not height > 1e-9 * length:
        return axis, strength, any_across(axis), 0.0
    return axis, strength, bulge / height, min(1.0, height / length * 4)
