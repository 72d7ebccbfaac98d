"""The shape of the reference frame, where no surface comes with the data."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.modes.topology import CUP, SPHERE, Topology
from modalmotion.template import Template, make_template
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.folding import require_unfolded
from modalmotion.tracking.observation import Frame
from modalmotion.tracking.passes import evidence, first_guess
from modalmotion.tracking.posterior import across_covariance
from modalmotion.tracking.settling import settle
from modalmotion.tracking.start import start_shape

# Modes of the shape that a start from landmarks is brought to, and how often its prior is renewed.
_SHAPE_MODES: Final = 111
_SHAPE_ROUNDS: Final = 4


# Spread across a line, and across a plane, over the largest: points within rounding of a line leave
# every surface about it, and a closed surface as thin as a sheet encloses what nobody measured.
_LINE: Final = 1e-3
_SHEET: Final = 0.02

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
    covariance : (3 n, 3 n) float64, length unit squared
        Of their amplitudes across the surface: where no points are, what the prior leaves open.
    """

    template: Template
    grid: tuple[int, ...] | None
    shapes: NDArray[np.float64]
    covariance: NDArray[np.float64]


def shape_in(frame: Frame, number: int, topology: Topology | str | None) -> FirstShape:
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
    places = landmarks_of(frame)
    if isinstance(topology, str):
        topology = Topology.parse(topology)
    if topology is None:
        topology = CUP if {"apex", "base"} <= set(places) else SPHERE
    points = [part.points for part in frame if not part.is_landmark]
    cloud = np.concatenate(points) if points else np.zeros((0, 3))
    if len(cloud) < 4:
        raise ShapeError(
            f"Frame {number}, which the shape is taken from, has {len(cloud)} points.",
            remedy="Name a reference frame with more points, or give a surface as start.",
            frame=number,
        )
    if not np.ptp(cloud, axis=0).max() > _LEAST_SPREAD:
        raise ShapeError(
            f"The points of frame {number}, which the shape is taken from, lie in one place.",
            remedy="Name a reference frame whose points lie on the surface, or give a surface as "
            "start.",
            frame=number,
        )
    _require_extent(cloud, number, topology)
    rough = start_shape(topology, cloud, places)
    surface = Deformable.of(make_template(rough), _SHAPE_MODES)
    prior, noise = first_guess(surface)
    a = np.zeros((len(surface), 3))
    for _ in range(_SHAPE_ROUNDS):
        own = settle(surface, frame, a, prior.variances(surface.wavenumbers), noise)
        a = own.amplitudes
        prior, noise = evidence(surface, [own], prior)
    shape = surface.positions(a)
    require_unfolded(surface, shape[None])
    fitted = mesh_sequence(shape[None], rough.faces, grid=rough.grid, topology=topology)
    covariance = across_covariance(own.covariance, own.information)
    return FirstShape(make_template(fitted), rough.grid, surface.shapes, covariance)


def landmarks_of(frame: Frame) -> dict[str, NDArray[np.float64]]:
    """Places of apex and base in a frame; the middle of the points of an end if nobody says it."""
    places = {
        part.end: part.points.mean(axis=0) for part in frame if part.end is not None and len(part)
    }
    places |= {
        name: part.points[i]
        for part in frame
        for i, name in enumerate(part.places or ())
        if isinstance(name, str)
    }
    return places


def _require_extent(cloud: NDArray[np.float64], number: int, topology: Topology) -> None:
    """Refuse points that no surface of the topology can be laid through."""
    if topology.n_axes != 2:
        return
    x = cloud - cloud.mean(axis=0)
    spreads = np.linalg.svd(x / np.abs(x).max(), compute_uv=False)
    if spreads[1] < _LINE * spreads[0]:
        raise ShapeError(
            f"The points of frame {number}, which the shape is taken from, lie on a line.",
            remedy="Name a reference frame whose points lie on the surface, give a surface as "
            "start, or state the topology open curve.",
            frame=number,
        )
    if topology == SPHERE and spreads[2] < _SHEET * spreads[0]:
        raise ShapeError(
            f"The points of frame {number}, which the shape is taken from, lie in a plane, where "
            "no closed surface is.",
            remedy="State the topology plane or closed curve, name another reference frame, or "
            "give a surface as start.",
            frame=number,
        )
