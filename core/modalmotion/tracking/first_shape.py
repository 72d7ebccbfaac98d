"""The shape of the reference frame, where no surface comes with the data."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from modalmotion import errors, mesh
from modalmotion.mesh import sequence
from modalmotion.modes.topologies import (
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    Topology,
    lattice_coordinates,
)
from modalmotion.representation import Floats
from modalmotion.template import Template, make_template
from modalmotion.tracking import closest, map_frames, normal_equations, observation
from modalmotion.tracking.deformable import Deformable, require_unfolded
from modalmotion.tracking.noise import Noise

# Fine enough that flat triangles on a ventricle are 0.03 mm off.
_SURFACE: Final = (32, 64)
_CURVE: Final = (128,)

# Polar angle at which the spheroid of a cup ends: beyond its equator, it narrows to the base.
_CUP_END: Final = 0.7 * np.pi

# Semi-axis over the standard deviation of points spread over an ellipsoid, an ellipse, a line.
_FACTORS: Final = {SPHERE: 3.0**0.5, CLOSED_CURVE: 2.0**0.5}
_LINE: Final = 3.0**0.5

# Points farther out than this times the median, by Mahalanobis, are strays.
_STRAY: Final = 2.0

STARTS: Final = (CUP, SPHERE, CYLINDER, PLANE, CLOSED_CURVE, OPEN_CURVE)
"""Topologies that tracking can start without a surface."""


def start_shape(
    topology: Topology, points: Floats, landmarks: Mapping[str, Floats]
) -> sequence.MeshSequence:
    """Place a spheroid, tube, sheet, ellipse or line among points.

    Parameters
    ----------
    topology : Topology
    points : (n, 3) float64, length unit
        Of the reference frame.
    landmarks : mapping of "apex" and "base" to (3,) float64, length unit

    Returns
    -------
    MeshSequence
        One frame, a lattice.

    Raises
    ------
    ParameterError
        If the topology cannot be started, or needs landmarks that are not there or in one place.
    """
    if topology not in STARTS:
        raise errors.ParameterError(
            f"A {topology} cannot be started from landmarks.",
            remedy="Give a starting surface, or use one of the topologies "
            f"{', '.join(t.name for t in STARTS)}.",
        )
    if topology in (CUP, CYLINDER) and not {"apex", "base"} <= set(landmarks):
        raise errors.ParameterError(
            f"A {topology} starts from the landmarks apex and base; "
            f"{', '.join(landmarks) or 'none'} came for the reference frame.",
            remedy="Give apex=x,y,z and base=x,y,z (the middle of the opening), or a starting "
            "surface.",
            details={"needed": ["apex", "base"]},
        )
    shape = _SURFACE if topology.n_axes == 2 else _CURVE
    coordinates = lattice_coordinates(topology, shape)
    s, theta = coordinates[:, 0], 2.0 * np.pi * coordinates[:, -1]
    middle, spread, axes = _ellipsoid(points)
    if {"apex", "base"} <= set(landmarks):
        apex, base = landmarks["apex"], landmarks["base"]
        length = float(np.linalg.norm(base - apex))
        if not length > 0:
            raise errors.ParameterError(
                "The landmarks apex and base coincide.",
                remedy="Give the two ends of the surface.",
            )
        axis = (base - apex) / length
        r = points - apex
        radii = np.linalg.norm(r - np.outer(r @ axis, axis), axis=1)
        radius = max(float(np.median(radii)), 1e-3 * length) if len(points) else length / 4
        axes = np.vstack([axis, closest.across(axis)])
        middle, extents = (apex + base) / 2, np.array([length / 2, radius, radius])
    else:
        extents = spread * _FACTORS.get(topology, _LINE)
        # Nothing is quite flat but sheets and curves.
        if topology == SPHERE:
            extents = np.maximum(extents, 0.05 * extents.max())
    local = _unit_shape(topology, s, theta)
    x: Floats = middle + (local * extents) @ axes
    faces = mesh.lattice_faces(topology, shape) if topology.n_axes == 2 else None
    return sequence.mesh_sequence(x[None], faces, grid=shape, topology=topology)


def _unit_shape(topology: Topology, s: Floats, theta: Floats) -> Floats:
    """Shape along its first axis from -1 to 1, of radius 1 about it."""
    if topology == CUP:
        polar = _CUP_END * s
        along = 2.0 * (1.0 - np.cos(polar)) / (1.0 - np.cos(_CUP_END)) - 1.0
        return np.column_stack(
            [along, np.sin(polar) * np.cos(theta), np.sin(polar) * np.sin(theta)]
        )
    if topology == SPHERE:
        r = np.sin(np.pi * s)
        return np.column_stack([-np.cos(np.pi * s), r * np.cos(theta), r * np.sin(theta)])
    if topology == CYLINDER:
        return np.column_stack([2.0 * s - 1.0, np.cos(theta), np.sin(theta)])
    if topology == PLANE:
        return np.column_stack([2.0 * s - 1.0, theta / np.pi - 1.0, 0.0 * s])
    if topology == CLOSED_CURVE:
        return np.column_stack([np.cos(theta), np.sin(theta), 0.0 * s])
    return np.column_stack([2.0 * s - 1.0, 0.0 * s, 0.0 * s])


def _ellipsoid(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Middle, standard deviations along the axes, longest first, and the axes as rows."""
    kept = points
    middle, spread, axes = np.zeros(3), np.ones(3), np.eye(3)
    for _ in range(3):
        if not len(kept):
            break
        middle = kept.mean(axis=0)
        variances, columns = np.linalg.eigh(np.cov((kept - middle).T, bias=True).reshape(3, 3))
        spread = np.sqrt(np.maximum(variances[::-1], 0.0))
        axes = np.ascontiguousarray(columns[:, ::-1].T)
        # A sign that depends on the points alone: the largest entry is positive.
        axes *= np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])[:, None]
        axes[2] = np.cross(axes[0], axes[1])
        u = (points - middle) @ axes.T / np.where(spread > 0, spread, 1.0)
        away = np.linalg.norm(u, axis=1)
        kept = points[away <= _STRAY * np.median(away)]
    return middle, spread, axes


# Modes of the shape that a start from landmarks is brought to, and how often its prior is renewed.
_SHAPE_MODES: Final = 111
_SHAPE_ROUNDS: Final = 4


# Spread across a line, and across a plane, over the largest: points within rounding of a line leave
# every surface about it, and a closed surface as thin as a sheet encloses what nobody measured.
_THIN: Final = 1e-3
_SHEET: Final = 0.02

_FEWEST: Final = 4

# Squares of squares of smaller lengths are zero.
_LEAST_SPREAD: Final = 1e-60


class FirstShape(NamedTuple):
    """The shape that was reached.

    Parameters
    ----------
    template : Template
    grid : tuple of int or None
        Its lattice.
    shapes : (vertices, n) float64
        Of the modes that it was brought there by.
    noise : Noise
    covariance : (3 n, 3 n) float64, length unit squared
        Of their amplitudes across the surface: where no points are, what the prior leaves open.
    """

    template: Template
    grid: tuple[int, ...] | None
    shapes: Floats
    noise: Noise
    covariance: Floats


def shape_in(frame: observation.Frame, number: int, topology: Topology | str | None) -> FirstShape:
    """Bring a start by landmarks to the points of one frame.

    Parameters
    ----------
    frame : Frame
    number : int
        Of the frame, for errors.
    topology : Topology or str, optional
        Cup where apex and base are stated, else sphere.

    Raises
    ------
    InputError
        If there are too few points, or the landmarks that the topology needs are missing.
    """
    places = observation.ends_in(frame)
    if isinstance(topology, str):
        topology = Topology.parse(topology)
    if topology is None:
        topology = CUP if {"apex", "base"} <= set(places) else SPHERE
    points = [part.points for part in frame if not part.is_landmark]
    cloud = np.concatenate([np.zeros((0, 3)), *points])
    _require_extent(cloud, number, topology)
    rough = start_shape(topology, cloud, places)
    surface = Deformable.of(make_template(rough), _SHAPE_MODES)
    prior, noise = map_frames.first_guess(surface)
    a = np.zeros((len(surface), 3))
    for _ in range(_SHAPE_ROUNDS):
        own = map_frames.map_frame(surface, frame, a, prior.variances(surface.wavenumbers), noise)
        a = own.amplitudes
        prior, noise = map_frames.shape_evidence(surface, own, prior)
    shape = surface.positions(a)
    require_unfolded(surface, shape[None])
    fitted = sequence.mesh_sequence(shape[None], rough.faces, grid=rough.grid, topology=topology)
    covariance = normal_equations.across_covariance(own.covariance, own.information)
    return FirstShape(make_template(fitted), rough.grid, surface.shapes, noise, covariance)


def _require_extent(cloud: Floats, number: int, topology: Topology) -> None:
    """Refuse points that no surface of the topology can be laid through."""
    is_surface, x = topology.n_axes == 2, cloud - cloud[:1]
    size = np.abs(x).max(initial=0.0)
    x = (x - x.mean(axis=0, keepdims=True)) / size if size > _LEAST_SPREAD else 0.0 * x
    spreads = np.linalg.svd(x, compute_uv=False) if len(x) else np.zeros(3)
    if len(cloud) < _FEWEST:
        reason, remedy = f"has {len(cloud)} points", "with more points"
    elif not size > _LEAST_SPREAD:
        reason, remedy = "has all its points in one place", "whose points are on the surface"
    elif is_surface and spreads[1] < _THIN * spreads[0]:
        reason = "has all its points on a line"
        remedy = "whose points are on the surface, set topology=open curve"
    elif topology == SPHERE and spreads[2] < _SHEET * spreads[0]:
        reason = "has all its points in a plane, so it shows no closed surface"
        remedy = "whose points are on the surface, set the topology to plane or closed curve"
    else:
        return
    raise errors.ShapeError(
        f"Frame {number}, from which the shape is taken, {reason}.",
        remedy=f"Name a reference frame {remedy}, or give a starting surface.",
        frame=number,
    )
