"""The 17 segments of the left ventricle, and the inward motion of each.

Cerqueira et al., Standardized myocardial segmentation and nomenclature for tomographic imaging of
the heart, Circulation, 2002.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.mesh import alignment
from modalmotion.mesh.facts import UNKNOWN
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import CUP
from modalmotion.representation import Floats, Ints, shown
from modalmotion.signature import making, reconstruction
from modalmotion.template import Landmarks, Template, body_frame

ANTERIOR: Final = "anterior"
"""The landmark from which segments are counted: any place in the middle of the anterior wall."""

RINGS: Final = ("basal", "mid", "apical", "apex")
_WALLS: Final = ("anterior", "anteroseptal", "inferoseptal", "inferior", "inferolateral")
_SIX: Final = (*_WALLS, "anterolateral")
_FOUR: Final = ("anterior", "septal", "inferior", "lateral")
SEGMENTS: Final = (
    *(f"basal {wall}" for wall in _SIX),
    *(f"mid {wall}" for wall in _SIX),
    *(f"apical {wall}" for wall in _FOUR),
    "apex",
)
"""Names of the segments 1 to 17."""

# Of the way from apex to base along the wall. The cap is beyond the cavity in the standard; an
# endocardium ends with it, so its last eighth represents the cap, and equal thirds the rest.
_CAP: Final = 0.125
_HEIGHTS: Final = (_CAP, _CAP + (1 - _CAP) / 3, _CAP + 2 * (1 - _CAP) / 3)


@shown("names", "shares", "sequence_id")
@dataclass(frozen=True, eq=False)
class RegionalMotion:
    """Inward motion of the wall by segment, over the radius at end diastole.

    Parameters
    ----------
    names : tuple of str
        The 17 segments, or the four rings if the anterior wall is unknown.
    shares : (frames, segments) float64, percent
        Positive inward; NaN for a segment without vertices.
    end_diastole : int
        Frame from which the motion is measured.
    reason : str
        Why there are rings only; empty if there are segments.
    sequence_id : str
    """

    names: tuple[str, ...]
    shares: Floats
    end_diastole: int
    reason: str
    sequence_id: str

    @property
    def has_segments(self) -> bool:
        """Whether these are the 17 segments, and not rings."""
        return len(self.names) == len(SEGMENTS)


def regional_motion(
    signature: making.ModalSignature,
    sequence: MeshSequence,
    end_diastole: int,
    *,
    template: Template | None = None,
) -> RegionalMotion:
    """Measure how far each segment of a ventricle's wall moves inward.

    Displacement of each vertex along the inward normal of the reference since end diastole,
    averaged by area, over the mean distance of its ring from the axis at end diastole. Rotation and
    drift of the whole are removed. Sliding along the surface does not count, to first order.

    Parameters
    ----------
    signature : ModalSignature
        Its rotations and translations are read.
    sequence : MeshSequence
        The one it was made from, as it was sent.
    end_diastole : int
        Frame from which the motion is measured.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Returns
    -------
    RegionalMotion

    Raises
    ------
    TopologyError
        If the surface is not a cup.
    """
    used = reconstruction.fitted_on(signature, sequence, template)
    landmarks = require_ventricle(used, signature.surface)
    start = alignment.reference_positions(sequence, signature.parameters.reference)
    centre = used.weights @ start
    size = float(np.abs(start - centre).max()) or 1.0
    normals = body_frame.directions_on(used, body_frame.Direction.NORMAL)
    heights = np.empty((sequence.n_frames, sequence.n_vertices))
    for frame, R in enumerate(signature.rotations.matrices):
        x = sequence.vertices[frame].astype(np.float64)
        # Back into the frame of the reference: R' (x - centroid).
        y = ((x - used.weights @ x) / size) @ R
        heights[frame] = np.einsum("vd,vd->v", y, normals)
        if frame == end_diastole:
            offsets = y - (landmarks.origin - centre) / size
            along = offsets @ landmarks.axis
            across = offsets - along[:, None] * landmarks.axis
            radii = np.linalg.norm(across, axis=1)
    inward = heights[end_diastole] - heights
    names, segment, reason = at_places(used, sequence.facts, used.coordinates[:, 0], used.vertices)
    ring = rings_of(used.coordinates[:, 0])
    shares = np.full((sequence.n_frames, len(names)), np.nan)
    for number in range(len(names)):
        mine = np.where(segment == number, used.weights, 0.0)
        if not mine.any():
            continue
        # The cap has no radius of its own; that of the ring below it is used.
        own = min(int(ring[mine > 0].max()), 2)
        of_ring = np.where(ring == own, used.weights, 0.0)
        radius = float(of_ring @ radii) / float(of_ring.sum() or 1.0)
        shares[:, number] = 100.0 * (inward @ mine) / (float(mine.sum()) * (radius or 1.0))
    return RegionalMotion(names, shares, end_diastole, reason, signature.sequence_id)


def rings_of(s: Floats) -> Ints:
    """Return the ring at each height, from 0 basal to 3 apex."""
    rings: Ints = 3 - np.searchsorted(_HEIGHTS, s, side="right")
    return rings


def require_ventricle(template: Template, surface: str) -> Landmarks:
    """Return the landmarks of a ventricle's wall.

    Raises
    ------
    TopologyError
        If the surface is not a cup.
    """
    if template.surface != CUP or template.landmarks is None:
        raise errors.TopologyError(
            "Segments are defined for a ventricle, a cup from apex to base; this surface is a "
            f"{surface}.",
            remedy="Send the wall of a ventricle, open at its base, or set topology=cup.",
        )
    return template.landmarks


def at_places(
    template: Template, facts: mesh.Facts, s: Floats, places: Floats
) -> tuple[tuple[str, ...], Ints, str]:
    """Return the segment of each place on the reference.

    Parameters
    ----------
    template : Template
        Of a ventricle.
    facts : Facts
        Of its sequence: the landmark of the anterior wall, and the handedness of the coordinates.
    s : (places,) float64
        Position from apex to base.
    places : (places, 3) float64, length unit

    Returns
    -------
    names : tuple of str
        The 17 segments, or rings.
    segment : (places,) int64
    reason : str
        Why these are rings; empty if they are segments.
    """
    landmarks = require_ventricle(template, "mesh")
    ring = rings_of(s)
    point = facts.landmarks.get(ANTERIOR)
    if point is None:
        reason = (
            "The anterior wall is unknown, so the segments are rings. Give the landmark "
            f"'{ANTERIOR}', a vertex or a point in the middle of that wall."
        )
        return RINGS, ring, reason
    if facts.handedness == UNKNOWN and facts.coordinates == UNKNOWN:
        reason = (
            "Whether the coordinates are right-handed is unknown, so septal and lateral walls may "
            "be interchanged, and the segments are rings. Set the handedness, or coordinates to "
            "LPS or RAS."
        )
        return RINGS, ring, reason
    anterior = template.vertices[point] if isinstance(point, int) else np.array(point, dtype=float)
    away = np.stack([landmarks.theta_zero, np.cross(landmarks.axis, landmarks.theta_zero)])
    # Right-handed about the axis, which the columns of a lattice need not be.
    x, y = away @ (np.vstack([places, anterior]) - landmarks.origin).T
    azimuths = np.arctan2(y, x) / (2 * np.pi)
    theta = azimuths[:-1] - azimuths[-1]
    # From anterior over septal to inferior: against the right-handed sense about the axis from
    # apex to base, and with it where the coordinates are left-handed.
    turns = np.mod(theta if facts.handedness == "left" else -theta, 1.0)
    six = np.floor(np.mod(6 * turns + 0.5, 6)).astype(np.int64)
    four = np.floor(np.mod(4 * turns + 0.5, 4)).astype(np.int64)
    segment = np.choose(ring, [six, 6 + six, 12 + four, np.full_like(ring, 16)])
    return SEGMENTS, segment, ""
