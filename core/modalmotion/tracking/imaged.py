"""A track from images, with what they add to it: convention, slices, and errors in common."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.images import ImageSequence, PlaneSet
from modalmotion.images.sequence import is_of_labels
from modalmotion.mesh import face_areas, face_normals
from modalmotion.tracking.image_answer import ImageAnswer
from modalmotion.tracking.image_frames import ImageFrames
from modalmotion.tracking.label_maps import CUT_HEIGHT
from modalmotion.tracking.papillary import papillary_volume
from modalmotion.tracking.result import Track

# Of a voxel, and of the noise of one edge (speckle is alike at neighbours): how far all edges may
# be off alike, which no residual shows.
_OF_VOXEL: Final = 0.08
_OF_NOISE: Final = 0.4

# Of a label map: see `staircase`.
_STAIRCASE: Final = 0.25

# Of muscle that is beyond the edges seen: how much of its depth at one place, and how much of all
# of it is not known.
_OF_CLOSED: Final = 0.5
_OF_ALL_CLOSED: Final = 0.3


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
    if is_of_labels(first):
        patch = float(np.sqrt(areas.mean() / len(track.modes)))
        localisation = staircase(voxel, patch)
        # The opening ends where voxels do.
        lids = np.array([_opening(x, track.template.faces) for x in shapes])
        of_volumes = np.hypot(localisation * areas, CUT_HEIGHT * voxel * lids)
    else:
        localisation = float(np.hypot(_OF_VOXEL * voxel, _OF_NOISE * track.noise.sd))
        of_volumes = localisation * areas
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
    closed = _OF_CLOSED * found.closed
    deviations = np.array(track.deviations)
    deviations[..., 0] = np.sqrt(
        deviations[..., 0] ** 2 + answer.localisation**2 + found.bent**2 + closed[:, None] ** 2
    )
    volume_deviations = track.volume_deviations
    if volume_deviations is not None:
        volume_deviations = np.hypot(
            volume_deviations, np.hypot(of_volumes, _OF_ALL_CLOSED * found.closed * areas)
        )
    return replace(track, deviations=deviations, volume_deviations=volume_deviations, images=answer)


def _opening(x: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    """Area of a surface's opening, for the vector areas of a closed one add up to nothing."""
    return float(np.linalg.norm(face_normals(x, faces).sum(axis=0))) / 2.0


def staircase(voxel: float, patch: float) -> float:
    """Deviation that the staircase of a label map leaves where it does not average out, mm.

    Parameters
    ----------
    voxel : float, mm
    patch : float, mm
        Side of the patches that modes tell apart.

    Notes
    -----
    An edge between two voxels lies anywhere within one: h^2 / 12 is its variance. Where the surface
    is aslant by t to the voxels' faces a step follows on the other after h / t, and the mean over a
    patch of side L is right as soon as that is shorter than L. The rest are directions within
    about h / L of a face's normal, or of a diagonal's: a share as (h / L)^2 of all, so that h^2 / L
    times a number is left. It is 0.25, by simulation over all directions. Steps that are closer are
    noise of the edges, which residuals show.
    """
    return float(_STAIRCASE * voxel**2 / patch)
