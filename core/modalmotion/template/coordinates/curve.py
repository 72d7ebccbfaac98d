"""Natural coordinates of curves: contours whose vertices come in order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.triangles import curve_weights, step_lengths
from modalmotion.modes.topology import CLOSED_CURVE, Topology
from modalmotion.numeric.products import second_moments, weighted_sum
from modalmotion.template.coordinates.axis import any_across, towards
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.landmarks import Landmarks


def curve_coordinates(
    vertices: NDArray[np.float64], topology: Topology, places: dict[str, NDArray[np.float64]]
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
        If the stated start lies on the curve's own axis.
    """
    closed = topology == CLOSED_CURVE
    steps = step_lengths(vertices, topology)
    total = float(steps.sum())
    reached = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    notes: list[str] = []
    if not total > 0:
        notes.append("The curve has no length; its vertices are taken to be evenly spread.")
        n = len(vertices)
        values = np.arange(n) / (n if closed else max(n - 1, 1))
        total_or_one = 1.0
    else:
        values, total_or_one = reached / total, total
        if not closed:
            # Rounding of the sum must not push the end beyond 1.
            values = np.append(reached, total)[: len(vertices)] / total
    weights = curve_weights(vertices, topology)
    centre = weighted_sum(weights, vertices) / (weights.sum() or 1.0)
    landmarks = (_closed if closed else _open)(vertices, centre, total_or_one, places)
    if closed and "theta_zero" in places:
        values = values - _nearest(vertices, steps, places["theta_zero"]) / total_or_one
    return Coordinates(topology, values[:, None], landmarks, tuple(notes))


def _nearest(
    vertices: NDArray[np.float64], steps: NDArray[np.float64], place: NDArray[np.float64]
) -> float:
    """Length along a closed curve at which it comes nearest to a place."""
    sides = np.roll(vertices, -1, axis=0) - vertices
    reach = np.einsum("ij,ij->i", place - vertices, sides) / np.where(steps > 0, steps**2, 1.0)
    share = np.clip(reach, 0.0, 1.0)
    gaps = np.linalg.norm(vertices + share[:, None] * sides - place, axis=1)
    k = int(np.argmin(gaps))
    return float(steps[:k].sum() + share[k] * steps[k])


def _closed(
    vertices: NDArray[np.float64],
    centre: NDArray[np.float64],
    length: float,
    places: dict[str, NDArray[np.float64]],
) -> Landmarks:
    # The axis is the area vector: half the integral of x times dx.
    offsets = vertices - centre
    area = 0.5 * np.cross(offsets, np.roll(offsets, -1, axis=0)).sum(axis=0)
    size = float(np.linalg.norm(area))
    # Of all curves of one length the circle has the largest area, L^2 / 4 pi.
    strength = min(1.0, size * 4 * np.pi / length**2)
    start = places.get("theta_zero", vertices[0])
    if strength > 1e-9:
        axis = area / size
        across = start - centre - ((start - centre) @ axis) * axis
        reach = float(np.linalg.norm(across))
        named = "theta_zero" in places
        zero = (
            towards(start, centre, axis, length)
            if named or reach > 1e-6 * length
            else any_across(axis)
        )
    else:
        axis, strength = np.array([0.0, 0.0, 1.0]), 0.0
        zero = any_across(axis)
    return Landmarks(
        origin=centre,
        axis=axis,
        theta_zero=zero,
        apex=centre,
        base=centre,
        # The sender decides which vertex is first.
        strengths={"axis": strength, "theta_zero": 1.0 if strength > 0 else 0.0},
        n_loops=0,
        given=tuple(places),
    )


def _open(
    vertices: NDArray[np.float64],
    centre: NDArray[np.float64],
    length: float,
    places: dict[str, NDArray[np.float64]],
) -> Landmarks:
    # The axis is the chord; theta_zero points to the side on which the curve bulges.
    chord = vertices[-1] - vertices[0]
    reach = float(np.linalg.norm(chord))
    strength = min(1.0, reach / length)
    if strength > 1e-9:
        axis = chord / reach
    else:
        offsets = vertices - centre
        axis = np.linalg.eigh(second_moments(np.ones(len(vertices)), offsets, offsets))[1][:, 2]
        strength = 0.0
    bulge = centre - (vertices[0] + vertices[-1]) / 2
    bulge = bulge - (bulge @ axis) * axis
    height = float(np.linalg.norm(bulge))
    is_straight = not height > 1e-9 * length
    return Landmarks(
        origin=centre,
        axis=axis,
        theta_zero=any_across(axis) if is_straight else bulge / height,
        apex=vertices[0],
        base=vertices[-1],
        strengths={
            "axis": strength,
            "theta_zero": 0.0 if is_straight else min(1.0, height / length * 4),
        },
        n_loops=0,
        given=tuple(places),
    )
