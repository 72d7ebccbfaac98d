"""Natural coordinates of cups, cylinders and spheres: a potential and an azimuth."""

from typing import Final

import numpy as np

from modalmotion.modes.topologies import CUP, CYLINDER, SPHERE
from modalmotion.notes import Note
from modalmotion.progress import Reporter, silent
from modalmotion.representation import Floats
from modalmotion.template import surfaces
from modalmotion.template.axis import (
    Axes,
    axes_about,
    azimuth,
    direction_between,
    height_along,
    landmarks_at,
    lean,
    origin_on,
    potential,
    principal_axes,
    skewness,
    widest_across,
)
from modalmotion.template.landmarks import Coordinates

# s = (1 - u / max u)^(5/8): 1/2 is exact on a flat disk, 3/4 serves a long tube.
_EXPONENT: Final = 5 / 8

# The cap around the apex is where the torsion function is largest; this power of it is the
# weight that the apex is the centroid of.
_CAP: Final = 8


# Below this angle, rad, from the plane of its rim a cap is taken to be flat.
_FLAT_CAP: Final = 1e-3


def cup_coordinates(
    surface: surfaces.Surface, places: dict[str, Floats], axes: Axes, report: Reporter = silent
) -> Coordinates:
    """Torsion function towards the openings, and azimuth about the axis.

    Parameters
    ----------
    surface : Surface
        One piece with openings, all of them at its base.
    places : dict of str to (3,) float64
        Positions of the stated landmarks.
    axes : Axes
        From `cup_axes`.
    report : callable, optional
        Told the share that is done.
    """
    notes: list[Note] = []
    u = _torsion(surface, report)
    if u is None:
        notes.append(Note.of("coordinates_by_height"))
        cap = np.ones_like(surface.areas)
    else:
        cap = np.clip(u, 0.0, 1.0) ** _CAP
    apex, roundness = _centre_of_cap(surface, cap)
    origin = origin_on(surface, axes.axis, places)
    offsets = surface.vertices - origin
    theta = azimuth(offsets, axes.axis, axes.zero)
    s = height_along(offsets, axes.axis) if u is None else (1 - np.clip(u, 0.0, 1.0)) ** _EXPONENT
    if len(surface.openings) > 2:
        notes.append(Note.of("several_openings", n_openings=len(surface.openings)))
    strengths = {"apex": roundness, "base": _agreement(surface)}
    strengths |= {name: 1.0 for name in strengths if name in places}
    base = surfaces.base_of(surface)
    landmarks = landmarks_at(surface, places, axes, origin, apex, base, strengths)
    return Coordinates(CUP, np.stack([s, theta], axis=1), landmarks, tuple(notes))


def _cap_of(surface: surfaces.Surface, opening: surfaces.Opening) -> tuple[float, float]:
    """Area of the cap that an apex was cut off with, and how far u rises over its rim.

    The cap of the sphere that the wall touches along the rim: of radius r = a / sin w for a rim of
    radius a that the wall meets at the angle w from its plane, with the area 2 pi r^2 (1 - cos w)
    and -Laplace u = 1 solved by 2 r^2 log(cos(x / 2)), x from its pole on.
    """
    on_rim = np.zeros(len(surface.vertices), dtype=np.bool_)
    on_rim[opening.vertices] = True
    faces = surface.faces[on_rim[surface.faces].sum(axis=1) == 2]
    # The two corners on the rim first.
    order = np.argsort(~on_rim[faces], axis=1, kind="stable")
    a, b, c = surface.vertices[np.take_along_axis(faces, order, axis=1)].transpose(1, 0, 2)
    edges, middles = b - a, (a + b) / 2
    # Across each edge within its triangle, as long as the edge: their sum is that of a smooth rim.
    across = middles - c
    squares = np.maximum(np.einsum("ij,ij->i", edges, edges), 1e-300)
    across -= (np.einsum("ij,ij->i", across, edges) / squares)[:, None] * edges
    across *= (np.sqrt(squares) / np.maximum(np.linalg.norm(across, axis=1), 1e-300))[:, None]
    upward = opening.centre - surface.centroid
    upward /= max(float(np.linalg.norm(upward)), 1e-300)
    inward = opening.centre - middles
    inward -= (inward @ upward)[:, None] * upward
    inward /= np.maximum(np.linalg.norm(inward, axis=1), 1e-300)[:, None]
    w = float(np.arctan2((across @ upward).sum(), np.einsum("ij,ij->", across, inward)))
    radius = surfaces.radius_of(surface, opening)
    if w < _FLAT_CAP:
        return np.pi * radius**2, radius**2 / 4
    # A wall that opens towards its rim says nothing of a cap: half a sphere is the most.
    w = min(w, np.pi / 2)
    r = radius / np.sin(w)
    return 2 * np.pi * r**2 * (1 - np.cos(w)), float(-2 * r**2 * np.log(np.cos(w / 2)))


def _torsion(surface: surfaces.Surface, report: Reporter) -> Floats | None:
    """Solve -Laplace u = 1 with u = 0 on the openings of the base, over what it is at the pole.

    None if that is impossible. Through the rim of an apex that is cut off flows what its cap
    gives rise to.
    """
    openings, cut = surfaces.base_openings(surface), surfaces.apical_opening(surface)
    border = np.concatenate([opening.vertices for opening in openings])
    sources, above = surface.areas, 0.0
    if cut is not None:
        area, above = _cap_of(surface, cut)
        sources = sources.copy()
        sources[cut.vertices] += area / len(cut.vertices)
    u = potential(surface, sources, border, np.zeros(len(border)), report)
    if u is None or not u.max() > 0:
        return None
    highest = float(u.max()) if cut is None else float(u[cut.vertices].mean())
    return np.asarray(u / max(float(u.max()), highest + above))


def cup_axes(surface: surfaces.Surface, places: dict[str, Floats]) -> Axes:
    """Find the axis from apex, or area centroid, to base, and the side to which the wall leans.

    Raises
    ------
    ParameterError
        If a stated landmark gives no direction.
    """
    strength = 1.0 if {"apex", "base"} & set(places) else surfaces.axis_strength(surface)
    if strength < surfaces.FAINT_AXIS or (strength < 1.0 and surfaces.is_flat(surface)):
        # The base is on neither side, but the normal still is an axis.
        axis, strength = principal_axes(surface)[1][2], 0.0
    else:
        apex = places.get("apex", surface.centroid)
        base = places.get("base", surfaces.base_of(surface))
        axis = direction_between(surface, apex, base)
    return axes_about(surface, places, axis, lean(surface, axis), {"axis": strength})


def _centre_of_cap(surface: surfaces.Surface, cap: Floats) -> tuple[Floats, float]:
    """Centroid of the cap, and how round it is: 0 for a ridge, 1 for a round top."""
    weights = surface.areas * cap
    weights /= weights.sum()
    apex = weights @ surface.vertices
    offsets = surface.vertices - apex
    _, middle, large = np.linalg.eigvalsh((offsets * weights[:, None]).T @ offsets)
    return apex, float(np.sqrt(max(middle, 0.0) / large)) if large > 0 else 0.0


def _agreement(surface: surfaces.Surface) -> float:
    """Whether the openings are on one side: length of their mean direction, 0 to 1."""
    lengths = np.array([opening.length for opening in surface.openings])
    arms = np.stack([opening.centre for opening in surface.openings]) - surface.centroid
    reach = float(lengths @ np.linalg.norm(arms, axis=1))
    # Of one opening it is 1 up to rounding.
    return min(1.0, float(np.linalg.norm(lengths @ arms)) / reach) if reach > 0 else 0.0


def cylinder_axes(surface: surfaces.Surface, places: dict[str, Floats]) -> Axes:
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
    surface: surfaces.Surface, places: dict[str, Floats], axes: Axes, report: Reporter = silent
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
    notes: list[Note] = []
    held = np.concatenate([near.vertices, far.vertices])
    values = np.repeat([0.0, 1.0], [len(near.vertices), len(far.vertices)])
    s = potential(surface, np.zeros(len(theta)), held, values, report)
    if s is None:
        notes.append(Note.of("coordinates_by_height"))
        s = height_along(offsets, axis)
    landmarks = landmarks_at(
        surface, places, axes, origin, near.centre, far.centre, {"apex": 1.0, "base": 1.0}
    )
    return Coordinates(
        CYLINDER, np.stack([np.clip(s, 0.0, 1.0), theta], axis=1), landmarks, tuple(notes)
    )


def _ends(
    surface: surfaces.Surface, places: dict[str, Floats]
) -> tuple[surfaces.Opening, surfaces.Opening, float]:
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


def sphere_axes(surface: surfaces.Surface, places: dict[str, Floats]) -> Axes:
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
    surface: surfaces.Surface, places: dict[str, Floats], axes: Axes, report: Reporter = silent
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
    height = surface.offsets @ axis
    theta = azimuth(surface.vertices - origin, axis, axes.zero)
    notes: list[Note] = []
    none = np.zeros(0, dtype=np.int64)
    u = potential(surface, surface.areas * height, none, np.zeros(0), report)
    if u is None:
        notes.append(Note.of("coordinates_by_angle"))
        u = height
    used = np.delete(u, surface.isolated)
    low, high = used.min(), used.max()
    # u is cos(pi s) turned over: its extremes are the poles.
    s = np.arccos(np.clip((high + low - 2 * u) / ((high - low) or 1.0), -1.0, 1.0)) / np.pi
    near, far = (
        ((surface.areas * cap) @ surface.vertices) / float((surface.areas * cap).sum())
        for cap in ((1 - s) ** _CAP, s**_CAP)
    )
    landmarks = landmarks_at(surface, places, axes, origin, near, far)
    return Coordinates(SPHERE, np.stack([s, theta], axis=1), landmarks, tuple(notes))


AXIAL: Final = {
    CUP: (cup_axes, cup_coordinates),
    CYLINDER: (cylinder_axes, cylinder_coordinates),
    SPHERE: (sphere_axes, sphere_coordinates),
}
"""Axes and coordinates by topology."""
