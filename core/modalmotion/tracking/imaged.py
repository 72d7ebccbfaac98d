"""A track from images, with what they add to it: convention, slices, and errors in common.

The surface is that of the compact wall, papillary muscles within the pool: edges nearer to the
axis are crossed where blood is beyond them, and are strays where none does. Muscle keeps its
volume over the beat. So one number turns volumes of the convention `pool` into those of the
convention `wall`, in which muscles do not count as cavity.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.images import ImageSequence, PlaneSet
from modalmotion.images.sequence import Image, is_of_labels
from modalmotion.mesh import face_areas
from modalmotion.tracking.image_frames import ImageFrames
from modalmotion.tracking.image_view import Facets, Sight
from modalmotion.tracking.result import ImageAnswer, Track

Floats = NDArray[np.float64]

# Of a voxel, and of the noise of one edge (speckle is alike at neighbours): how far all edges may
# be off alike, which no residual shows.
_OF_VOXEL: Final = 0.08
_OF_NOISE: Final = 0.4

# Of muscle that is beyond the edges seen: how much of its depth at one place, and how much of all
# of it is not known.
_OF_CLOSED: Final = 0.5
_OF_ALL_CLOSED: Final = 0.3

# Places on lines from the middle to the surface, as shares.
_SHARES: Final = (np.arange(20) + 0.5) / 20.0

# Of a voxel's longer side in the image: nearer to the surface its own edge is seen.
_SHELL: Final = 1.4


def with_images(track: Track, images: ImageSequence, found: ImageFrames) -> Track:
    """Add to a track of edges what its images were like.

    Parameters
    ----------
    track : Track
        Of the observations in `found`.
    images : ImageSequence
    found : ImageFrames

    Returns
    -------
    Track
        Its deviations with those that residuals do not show: of a bias that all edges have in
        common, and of bent stacks of slices.
    """
    images, sight = images.sliced(), found.sight
    shapes = track.sequence.vertices.astype(np.float64)
    first = next(frame for frame in images.frames if frame is not None)
    is_sliced = isinstance(first, PlaneSet)
    if isinstance(first, PlaneSet):
        voxel = max(max(plane.spacing) for plane in first.planes)
    else:
        voxel = max(first.spacing)
    areas = np.array([face_areas(x, track.template.faces).sum() for x in shapes])
    # Steps of a label map are noise of its edges, which residuals show.
    localisation = 0.0
    if not is_of_labels(first):
        localisation = float(np.hypot(_OF_VOXEL * voxel, _OF_NOISE * track.noise.sd))
    volumes = np.zeros(len(shapes)) if track.volumes is None else track.volumes
    answer = ImageAnswer(
        found.papillary,
        papillary_volume(images.frames, shapes, volumes, found.facets, sight),
        sight.levels.inside,
        sight.levels.outside,
        sight.levels.spread,
        tuple(sight.slope.tolist()),
        tuple(tuple(row) for row in sight.shifts.tolist()) if is_sliced else (),
        sight.shift_sd if is_sliced else 0.0,
        tuple(found.found.tolist()),
        localisation,
        float(np.sqrt(np.average(found.bent**2, weights=track.template.weights))),
    )
    at_places = _OF_CLOSED * found.closed[:, None]
    deviations = np.array(track.deviations)
    deviations[..., 0] = np.sqrt(
        deviations[..., 0] ** 2 + answer.localisation**2 + found.bent**2 + at_places**2
    )
    volume_deviations = track.volume_deviations
    if volume_deviations is not None:
        closed = _OF_ALL_CLOSED * found.closed
        volume_deviations = np.hypot(volume_deviations, np.hypot(localisation, closed) * areas)
    return replace(track, deviations=deviations, volume_deviations=volume_deviations, images=answer)


def papillary_volume(
    images: Iterable[Image | None], shapes: Floats, volumes: Floats, facets: Facets, sight: Sight
) -> float:
    """Volume within the surface that looks like the outside, mm^3: the median of the frames.

    Parameters
    ----------
    images : iterable of Volume, PlaneSet or None
    shapes : (frames, vertices, 3) float64, mm
    volumes : (frames,) float64, mm^3
    facets : Facets
    sight : Sight
    """
    own = [
        _share(image, x, facets, sight) * volume
        for image, x, volume in zip(images, shapes, volumes, strict=True)
        if image is not None
    ]
    return float(max(np.median(own), 0.0)) if own else 0.0


def _side(image: Image) -> float:
    if isinstance(image, PlaneSet):
        return max(max(plane.spacing) for plane in image.planes)
    return float(np.median(image.spacing))


def _share(image: Image, x: Floats, facets: Facets, sight: Sight) -> float:
    """Share of the cavity, weighted by volume, that is like the outside."""
    corners = x[facets.faces]
    middle = x.mean(axis=0)
    centres = corners.mean(axis=1) - middle
    # Cones from the middle: dV = 3 V t^2 dt.
    cones = np.abs((np.cross(corners[:, 1] - middle, corners[:, 2] - middle) * centres).sum(axis=1))
    points = (middle + _SHARES[:, None, None] * centres).reshape(-1, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = (normals * centres).sum(axis=1) / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    depths = np.outer(1.0 - _SHARES, np.abs(heights))
    weights = (_SHARES[:, None] ** 2 * cones).ravel()
    is_deep = (depths > _SHELL * _side(image)).ravel()
    if isinstance(image, PlaneSet):
        near = [np.abs(plane.heights(points)) < plane.thickness / 2 for plane in image.planes]
        views = zip(image.planes, near, sight.shifts, strict=True)
        values = np.concatenate([p.sample(points[own] + shift) for p, own, shift in views])
        rows = np.concatenate([np.flatnonzero(own) for own in near])
        points, weights, is_deep = points[rows], weights[rows], is_deep[rows]
    else:
        values = image.sample(points)
    there = np.isfinite(values)
    dark = (1.0 - sight.levels.likeness(values[there], sight.gain(points[there]))) / 2.0
    # What noise does to blood on either side cancels in the mean.
    muscle = (weights[there] * is_deep[there] * np.clip(dark, -0.5, 1.5)).sum()
    total = float(weights[there].sum())
    return float(muscle) / total if total > 0 else 0.0
