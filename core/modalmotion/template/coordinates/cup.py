"""Natural coordinates of cups: surfaces with one end open and a pole at the other."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CUP
from modalmotion.numeric.products import along, second_moments, weighted_sum
from modalmotion.template.coordinates.axis import (
    axis_between,
    azimuth,
    lean,
    principal_axes,
    theta_zero,
)
from modalmotion.template.coordinates.potential import potential
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.surface import Surface, mean_of

# s = (1 - u / max u)^(5/8): 1/2 is exact on a flat disk, 3/4 serves a long tube.
_EXPONENT: Final = 5 / 8

# A sheet whose thickness is below this share of its length has no side for an apex to lie on.
_FLAT: Final = 0.05

# A base nearer to the area centroid than this gives no axis.
FAINT_AXIS: Final = 0.02

# The cap around the apex is where the torsion function is largest; this power of it is the
# weight that the apex is the centroid of.
_CAP: Final = 8


def cup_coordinates(surface: Surface, places: dict[str, NDArray[np.float64]]) -> Coordinates:
    """Torsion function towards the openings, and azimuth about the axis.

    Parameters
    ----------
    surface : Surface
        One piece with openings, all of them at its base.
    places : dict of str to (3,) float64
        Positions of the stated landmarks.

    Raises
    ------
    ParameterError
        If a stated landmark gives no direction.
    """
    notes: list[str] = []
    u = _torsion(surface)
    if u is None:
        notes.append("The triangles are too thin to solve on; s is the height along the axis.")
        cap = np.ones_like(surface.areas)
    else:
        cap = np.clip(u / u.max(), 0.0, 1.0) ** _CAP
    apex, roundness = _centre_of_cap(surface, cap)
    base = places.get("base", mean_of(surface.openings))
    origin, axis, strength = _axis(surface, places, base)
    zero, zero_strength = theta_zero(surface, places, origin, axis, lean)
    offsets = surface.vertices - origin
    theta = azimuth(offsets, axis, zero)
    s = along(offsets, axis) if u is None else (1 - np.clip(u / u.max(), 0.0, 1.0)) ** _EXPONENT
    if u is None:
        s = (s - s.min()) / (np.ptp(s) or 1.0)
    if len(surface.openings) > 2:
        notes.append(
            f"All {len(surface.openings)} openings are taken for one base; the modes of a cup "
            "fit such a surface less well than one with a single base."
        )
    landmarks = Landmarks(
        origin=origin,
        axis=axis,
        theta_zero=zero,
        apex=places.get("apex", apex),
        base=base,
        strengths={
            "axis": strength,
            "apex": 1.0 if "apex" in places else roundness,
            "base": 1.0 if "base" in places else _agreement(surface),
            "theta_zero": zero_strength,
        },
        n_loops=len(surface.openings),
        given=tuple(places),
    )
    return Coordinates(CUP, np.stack([s, theta], axis=1), landmarks, tuple(notes))


def axis_strength(surface: Surface) -> float:
    """How far the base lies from the area centroid, 0 for a flat sheet, 1 for a deep cup."""
    # A hemisphere of the same area has its base at half this radius.
    radius = np.sqrt(surface.area / (2 * np.pi))
    return min(1.0, float(np.linalg.norm(surface.base - surface.centroid)) / float(radius))


def is_flat(surface: Surface) -> bool:
    """Whether the surface is a sheet: hardly thicker than nothing in one direction."""
    smallest, _, largest = np.maximum(np.linalg.eigh(surface.covariance)[0], 0.0)
    return bool(smallest < _FLAT**2 * largest)


def _torsion(surface: Surface) -> NDArray[np.float64] | None:
    """Solve -Laplace u = 1 with u = 0 on all openings; None where that is impossible."""
    border = np.concatenate([opening.vertices for opening in surface.openings])
    u = potential(surface, surface.areas, border, np.zeros(len(border)))
    return None if u is None or not u.max() > 0 else u


def _axis(
    surface: Surface, places: dict[str, NDArray[np.float64]], base: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    if "apex" in places:
        origin, axis = axis_between(surface, places["apex"], base)
        return origin, axis, 1.0
    if "base" in places:
        _, axis = axis_between(surface, surface.centroid, base)
        return surface.centroid, axis, 1.0
    strength = axis_strength(surface)
    if strength < FAINT_AXIS or is_flat(surface):
        # The base lies on neither side, but the normal still is an axis.
        return surface.centroid, principal_axes(surface)[1][2], 0.0
    _, axis = axis_between(surface, surface.centroid, base)
    return surface.centroid, axis, strength


def _centre_of_cap(surface: Surface, cap: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Centroid of the cap, and how round it is: 0 for a ridge, 1 for a round top."""
    weights = surface.areas * cap
    weights /= weights.sum()
    apex = weighted_sum(weights, surface.vertices)
    offsets = surface.vertices - apex
    _, middle, large = np.linalg.eigvalsh(second_moments(weights, offsets, offsets))
    return apex, float(np.sqrt(max(middle, 0.0) / large)) if large > 0 else 0.0


def _agreement(surface: Surface) -> float:
    """Whether the openings lie on one side: length of their mean direction, 0 to 1."""
    lengths = np.array([opening.length for opening in surface.openings])
    arms = np.stack([opening.centre for opening in surface.openings]) - surface.centroid
    reach = float(lengths @ np.linalg.norm(arms, axis=1))
    return float(np.linalg.norm(lengths @ arms)) / reach if reach > 0 else 0.0
