"""Tracks: what was found of a surface's motion, and how well."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Literal, TypeAlias, get_args

import numpy as np

from modalmotion.arguments.checking import FrozenArrays, Recorded
from modalmotion.errors import TopologyError
from modalmotion.mesh import checks, geometry
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes import ModeSet, topologies
from modalmotion.notes import Note
from modalmotion.representation import Bools, Floats, Ints, shown
from modalmotion.template import Template
from modalmotion.tracking.closest import unit_vectors
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.noise import Noise, Prior
from modalmotion.tracking.normal_equations import NormalEquations
from modalmotion.tracking.observation import Frame, spread_rows

Papillary: TypeAlias = Literal["pool", "wall"]
"""Convention of volumes of images: papillary muscles are cavity, or not."""

CONVENTIONS: Final[tuple[Papillary, ...]] = get_args(Papillary)

# Points of one frame, and of all: what a picture shows apart.
_MOST_OF_FRAME: Final = 500
_MOST: Final = 100_000
_LEAST_OF_FRAME: Final = 10

STRAY: Final = 0.1
"""Weight below which a point hardly counted."""


@shown("n_points")
@dataclass(frozen=True, eq=False)
class SampledData(FrozenArrays):
    """Points of all frames, one frame after the other; landmarks last in each.

    Parameters
    ----------
    points : (n, 3) float64, length unit
        Of images: the edges that were found.
    weights : (n,) float64
        That each counted with in the estimate, from 0 of a stray to 1; 1 for landmarks.
    are_landmarks : (n,) bool
    counts : (frames,) int64
        Points of each frame.
    """

    points: Floats
    weights: Floats
    are_landmarks: Bools
    counts: Ints

    @property
    def n_points(self) -> int:
        """Of all frames."""
        return len(self.points)

    def of_frame(self, frame: int) -> slice:
        """Rows of a frame."""
        stop = int(self.counts[: frame + 1].sum())
        return slice(stop - int(self.counts[frame]), stop)


def sample_of(frames: Sequence[Frame], informed: Sequence[NormalEquations]) -> SampledData:
    """Take a spread sample of the points of each frame, and all landmarks.

    Parameters
    ----------
    frames : sequence of Frame
    informed : sequence of NormalEquations
        Of the same frames: points and the weights that they counted with.

    Returns
    -------
    SampledData
        At most 500 points per frame and some 100,000 in all, beside landmarks.
    """
    most = min(_MOST_OF_FRAME, max(_LEAST_OF_FRAME, _MOST // max(1, len(frames))))
    points, weights, are_landmarks, counts = [np.zeros((0, 3))], [np.zeros(0)], [], []
    for frame, info in zip(frames, informed, strict=True):
        rows = spread_rows(len(info.points), most)
        marks = [part.points for part in frame if part.is_landmark]
        n_marks = sum(map(len, marks))
        points += [info.points[rows], *marks]
        weights += [info.weights[rows], np.ones(n_marks)]
        are_landmarks.append(np.repeat([False, True], [len(rows), n_marks]))
        counts.append(len(rows) + n_marks)
    return SampledData(
        np.concatenate(points),
        np.concatenate(weights),
        np.concatenate(are_landmarks),
        np.array(counts, dtype=np.int64),
    )


@shown("papillary", "papillary_volume", "inside", "outside", "shift_sd")
@dataclass(frozen=True)
class ImageAnswer:
    """Convention, brightness and slices of a track from images.

    Parameters
    ----------
    papillary : {"pool", "wall"}
        Convention of volumes: papillary muscles are cavity, or not.
    papillary_volume : float, mm^3
        That looks like muscle within the surface; it is taken off each volume under `wall`.
    inside, outside, spread : float
        Brightness on both sides in the reference frame, and the deviation of its noise.
    slope : tuple of float, 1 / mm
        Of the bias field.
    shifts : tuple of (float, float, float), mm
        By which each slice shows everything aside; none of volumes.
    shift_sd : float, mm
        Of a shift along one axis.
    found : tuple of float
        Share of the profiles with an edge in each frame.
    localisation : float, mm
        Deviation that all edges have in common, in volumes too.
    bent : float, mm
        Deviation that shifts of slices leave, RMS over the surface.
    """

    papillary: Papillary
    papillary_volume: float
    inside: float
    outside: float
    spread: float
    slope: tuple[float, ...]
    shifts: tuple[tuple[float, ...], ...]
    shift_sd: float
    found: tuple[float, ...]
    localisation: float
    bent: float

    def __post_init__(self) -> None:
        # JSON knows lists only.
        for name in ("slope", "found"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "shifts", tuple(tuple(row) for row in self.shifts))


@shown("sequence", "ejection_fraction:%", "modes", "noise", "unseen")
@dataclass(frozen=True, eq=False)
class Track(FrozenArrays, Recorded):
    """Motion of a surface found from observations, with its uncertainty.

    Parameters
    ----------
    sequence : MeshSequence
        The surface in every frame, tagged `tracking=normal_displacement`: along its normals it
        follows the data, along itself the prior.
    template : Template
        Of the start, whose shape amplitudes are counted from.
    modes : ModeSet
    amplitudes : (frames, modes, 3) float64, length unit
    covariances : (frames, 3 modes, 3 modes) float64, length unit squared
        Of the amplitudes; row 3 j + i is mode j in direction i.
    prior : Prior
    noise : Noise
    truncations : (frames,) float64, length unit
        RMS, in each direction, of what the modes leave.
    deviations : (frames, vertices, 2) float64, length unit
        Standard deviation of each vertex along its normal, and in each direction of the tangent
        plane, what the modes leave included.
    volume_deviations : (frames,) float64, length unit cubed, or None
        Standard deviation of each volume; None of what encloses none.
    residuals : (frames, 2) float64, length unit
        RMS and 95th percentile of the distances of the points that counted; NaN without any.
    inliers : (frames,) float64
        Share of the points that counted, 0 to 1; 0 without any.
    coverage : (frames,) float64
        Share of the surface that points are at, 0 to 1.
    unseen : tuple of int
        Frames without a point: there the chain of time alone speaks.
    reference : int or None
        Frame whose surface the start is, exactly; None if it is none's.
    notes : tuple of Note
    provenance : mapping
        Parameters and versions, for files.
    images : ImageAnswer or None
        Of a track from images: convention, brightness, slices.
    volume_correlation : float
        Of the errors of the largest and the smallest volume: those of an assumed base, and of a
        bias of all edges of images, are alike in both.
    data : SampledData or None
        Some of the points that it was tracked through, to be looked at.
    """

    sequence: MeshSequence
    template: Template
    modes: ModeSet
    amplitudes: Floats
    covariances: Floats
    prior: Prior
    noise: Noise
    truncations: Floats
    deviations: Floats
    volume_deviations: Floats | None
    residuals: Floats
    inliers: Floats
    coverage: Floats
    unseen: tuple[int, ...]
    reference: int | None
    notes: tuple[Note, ...]
    provenance: Mapping[str, Any]
    images: ImageAnswer | None = None
    volume_correlation: float = 0.0
    data: SampledData | None = None

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.amplitudes)

    def informed(self) -> "Track":
        """Return the track whose sequence carries what is known of it: errors, muscle, notes."""
        known = self.sequence.uncertainty
        if known is None:
            return self
        known = replace(
            known,
            source="points" if self.images is None else "images",
            volumes=self.volume_deviations,
            papillary_volume=self._taken_off,
            volume_correlation=self.volume_correlation,
            notes=self.notes,
        )
        return replace(self, sequence=replace(self.sequence, uncertainty=known))

    @cached_property
    def shapes(self) -> Floats:
        """What a unit of each amplitude moves the vertices by, (vertices, modes) float64."""
        return self._surface.shapes

    @cached_property
    def _surface(self) -> Deformable:
        return Deformable.of(self.template, len(self.modes)).exact_for_affine()

    @cached_property
    def mode_deviations(self) -> Floats:
        """Standard deviation of each amplitude across the surface and along it.

        Returns
        -------
        (frames, modes, 2) float64, length unit
            Of the part of the mode's motion along the normal, and of that in each direction of
            the tangent plane, RMS over the surface.
        """
        m = len(self.modes)
        deviations = np.empty((self.n_frames, m, 2))
        share = self.template.weights[:, None] * self.shapes**2
        share /= share.sum(axis=0)
        for f in range(self.n_frames):
            n = normals_of(self.template, self.sequence.vertices[f].astype(np.float64))
            N = np.einsum("vm,vi,vj->mij", share, n, n)
            own = self.covariances[f].reshape(m, 3, m, 3)[np.arange(m), :, np.arange(m), :]
            across = np.einsum("mij,mij->m", N, own)
            along = (np.trace(own, axis1=1, axis2=2) - across) / 2
            deviations[f] = np.sqrt(np.maximum(np.stack([across, along], axis=1), 0.0))
        return deviations

    @cached_property
    def determined(self) -> Floats:
        """Share of each mode that the data have set, across the surface and along it.

        Returns
        -------
        (modes, 2) float64
            1 - posterior / prior variance, mean over the frames with points: below 0.5 the
            prior has set it, and it counts as undetermined.
        """
        seen = [f for f in range(self.n_frames) if f not in self.unseen and f != self.reference]
        prior = self.prior.variances(self._surface.wavenumbers)[:, None]
        kept = self.mode_deviations[seen or slice(None)]
        return np.asarray(np.clip(1.0 - (kept**2).mean(axis=0) / prior, 0.0, 1.0))

    @cached_property
    def volumes(self) -> Floats | None:
        """Volume in each frame, (frames,) float64, length unit cubed; None of what has none.

        Of images under their convention: papillary muscles are taken off under `wall`.
        """
        cavity = cavity_in(self.template)
        if cavity is None:
            return None
        enclosed = np.abs(cavity.volume(self.sequence.vertices.astype(np.float64)))
        return enclosed - self._taken_off

    @property
    def _taken_off(self) -> float:
        """Papillary muscles that count as wall, length unit cubed."""
        images = self.images
        return images.papillary_volume if images and images.papillary == "wall" else 0.0

    @property
    def ejection_fractions(self) -> dict[str, float]:
        """Ejection fraction under each convention about papillary muscles; empty without images."""
        if self.images is None or self.volumes is None:
            return {}
        muscle, pool = self.images.papillary_volume, self.volumes + self._taken_off
        lost = float(pool.max() - pool.min())
        return {"pool": 100.0 * lost / pool.max(), "wall": 100.0 * lost / (pool.max() - muscle)}

    @property
    def ejection_fraction(self) -> float | None:
        """Share of the largest volume that the smallest lacks, percent; None without volumes."""
        v = self.volumes
        if v is None or self.n_frames < 2 or not v.max() > 0:
            return None
        return float(100.0 * (1.0 - v.min() / v.max()))

    @property
    def ejection_fraction_bound(self) -> float | None:
        """Two standard deviations of it, percentage points; None without volumes.

        dEF = (dV_ES - (1 - EF) dV_ED) / V_ED.
        """
        v, sd, fraction = self.volumes, self.volume_deviations, self.ejection_fraction
        if v is None or sd is None or fraction is None:
            return None
        ed, es = int(v.argmax()), int(v.argmin())
        start = (1.0 - fraction / 100.0) * float(sd[ed])
        correlation = self.volume_correlation
        return 200.0 * checks.difference_deviation(float(sd[es]), start, correlation) / float(v[ed])


def normals_of(template: Template, x: Floats) -> Floats:
    """Take unit normals of a surface, (vertices, 3); of a curve directions from its middle."""
    if len(template.faces):
        return geometry.vertex_normals(x, template.faces)
    tangents = np.gradient(x, axis=0)
    t = unit_vectors(tangents)
    r = x - x.mean(axis=0)
    return unit_vectors(r - (r * t).sum(axis=1, keepdims=True) * t)


def cavity_in(template: Template) -> geometry.Cavity | None:
    """Cavity of a surface; None of a curve and of what encloses nothing."""
    if template.topology.n_axes != 2 or template.topology == topologies.PLANE:
        return None
    try:
        return geometry.cavity_of(template.faces, template.n_vertices)
    except TopologyError:
        return None
