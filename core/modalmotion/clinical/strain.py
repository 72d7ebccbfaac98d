"""Strain of a wall: relative change of the length of lines on it since end diastole.

Definitions after Voigt et al., Definitions for a common standard for 2D speckle tracking
echocardiography, Eur Heart J Cardiovasc Imaging, 2015. They are lengths and areas of a surface, so
they need no points that follow the tissue.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy

from modalmotion import errors, mesh
from modalmotion.arguments.checking import Plotted
from modalmotion.clinical.dyssynchrony import (
    N_SECTORS,
    dyssynchrony,
    phases_of,
    sectors_of,
    segment_volumes,
    volume_variances,
)
from modalmotion.clinical.segments import RINGS, at_places
from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.clinical.volume_curve import TWO_DEVIATIONS
from modalmotion.clinical.wall_motion import (
    AREA,
    CIRCUMFERENTIAL,
    DIRECTIONS,
    LONGITUDINAL,
    Measure,
    WallMotion,
)
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import CUP, SPHERE
from modalmotion.notes import Note
from modalmotion.representation import Floats, Ints, shown
from modalmotion.signature import making, reconstruction
from modalmotion.template import Template, make_template
from modalmotion.tracking.result import Track

LEVELS: Final = ("apical", "mid", "basal")
"""Thirds of the wall's length, from the apex."""

DEFINITIONS: Final = {
    "GLS": "length of the wall from base to base through the apex, mean over lines around the axis",
    "GCS": "mean circumference at basal, mid and apical level",
    "GAS": "area of the wall",
}
"""Quantity of which each global strain is the relative change since end diastole."""

DYSSYNCHRONY: Final = "standard deviation of the times of minimum volume of 16 segments"
"""Definition of the dyssynchrony index, percent of the cycle."""

_LEVEL_NAMES: Final = tuple(f"GCS {level}" for level in LEVELS)
NAMES: Final = (*DEFINITIONS, *_LEVEL_NAMES)
"""Of the curves of a `Strain`."""

# Residual of a set of functions, in differences from the next coarser one: with each set errors
# fall to a third or less.
_LEFT: Final = 0.5

# Width of a narrow band, as a share of a level.
_BAND: Final = 0.5

# How far the apical strain around differs from the mid one, as a share of this: 0.16 and 0.09 of
# ventricles of two simulators.
_APICAL: Final = 0.16

_CAVITIES: Final = ("lv", "rv", "la", "ra", "other")


class Figure(NamedTuple):
    """A number and its 95 % interval, percent."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.1f} % ({self.low:.1f} to {self.high:.1f})"

    def __repr__(self) -> str:
        return str(self)


@dataclass(frozen=True, eq=False, repr=False)
class Strain(Plotted):
    """Strain since end diastole, percent: negative where the wall shortens.

    Parameters
    ----------
    names : tuple of str
        GLS, GCS, GAS (see `DEFINITIONS`), and GCS at each of the `LEVELS`.
    curves : (frames, names) float64, percent
    deviations : (frames, names) float64, percentage points
        Standard deviation of each.
    segments : tuple of str
        The 17 segments, or rings if the anterior wall is unknown.
    dyssynchrony : Figure or None
        Systolic dyssynchrony index: standard deviation of the times at which the volumes of 16
        segments are smallest, percent of the cycle. None for less than half a cycle, and for a
        surface without an apex.
    by_segment : (frames, segments, 3) float64, percent
        Longitudinal, circumferential, area.
    segment_deviations : (segments, 3) float64, percentage points
        At end systole.
    end_diastole, end_systole : int
        Frames of the largest and the smallest volume.
    layer : str
        Surface of the wall that was measured.
    source : str
        Its source: a mesh as sent, or a track.
    reason : str
        Why there are rings only; empty if there are segments.
    notes : tuple of Note
    sequence_id : str
    """

    names: tuple[str, ...]
    curves: Floats
    deviations: Floats
    dyssynchrony: Figure | None
    segments: tuple[str, ...]
    by_segment: Floats
    segment_deviations: Floats
    end_diastole: int
    end_systole: int
    layer: str
    source: str
    reason: str
    notes: tuple[Note, ...]
    sequence_id: str

    def __repr__(self) -> str:
        stated = self.end_systolic
        return f"Strain({', '.join(f'{name} {stated[name]}' for name in DEFINITIONS)})"

    @property
    def end_systolic(self) -> dict[str, Figure]:
        """Each strain at end systole."""
        return {name: self.at(name, self.end_systole) for name in self.names}

    @property
    def gls(self) -> Figure:
        """Global longitudinal strain at end systole."""
        return self.end_systolic["GLS"]

    @property
    def gcs(self) -> Figure:
        """Global circumferential strain at end systole."""
        return self.end_systolic["GCS"]

    @property
    def gas(self) -> Figure:
        """Global area strain at end systole."""
        return self.end_systolic["GAS"]

    @property
    def peak(self) -> dict[str, Figure]:
        """Each strain where it is most negative."""
        frames = self.curves.argmin(axis=0)
        return {name: self.at(name, frame) for name, frame in zip(self.names, frames, strict=True)}

    def at(self, name: str, frame: int) -> Figure:
        """Return a strain in a frame, with its interval."""
        place = self.names.index(name)
        value, reach = self.curves[frame, place], TWO_DEVIATIONS * self.deviations[frame, place]
        return Figure(float(value), float(value - reach), float(value + reach))


def strain(
    recording: MeshSequence | Track | making.ModalSignature,
    sequence: MeshSequence | None = None,
    *,
    template: Template | None = None,
) -> Strain:
    """Measure GLS, GCS, GAS, segmental strain and dyssynchrony, with 95 % intervals.

    Parameters
    ----------
    recording : MeshSequence, Track or ModalSignature
    sequence : MeshSequence, optional
        The one that a signature was made from: required with a signature.
    template : Template, optional
        The one that the signature's parameters name, or one for a sequence.

    Returns
    -------
    Strain
        Since the frame of the largest volume; at end systole that of the smallest.

    Raises
    ------
    TopologyError
        If the surface encloses nothing, or is not a cup, tube or sphere.
    ParameterError
        If the mesh has too few vertices, or this is none of the three.

    Examples
    --------
    >>> import modalmotion as mm
    >>> beat = mm.simulate_ventricle()
    >>> round(mm.strain(beat).end_systolic["GLS"].value)
    -21
    """
    if isinstance(recording, Track):
        measured, used = recording.sequence, recording.template
    elif isinstance(recording, making.ModalSignature):
        if sequence is None:
            raise errors.ParameterError(
                "A signature alone has no surface to measure strain on.",
                remedy="Give its sequence as well: strain(signature, sequence).",
            )
        measured, used = sequence, reconstruction.fitted_on(recording, sequence, template)
    elif isinstance(recording, MeshSequence):
        measured, used = recording, template or make_template(recording)
    else:
        raise errors.ParameterError(
            f"Strain was requested of {type(recording).__name__}.",
            remedy="Give a mesh sequence, a track, or a signature with its sequence.",
        )
    cavity = mesh.cavity_of(used.faces, used.n_vertices)
    volumes = np.abs(cavity.volume(measured.vertices.astype(np.float64)))
    return wall_strain(measured, used, int(volumes.argmax()), int(volumes.argmin()))


def wall_strain(
    sequence: MeshSequence, template: Template, end_diastole: int, end_systole: int
) -> Strain:
    """Measure the strain of a wall along it, around it, and of its area.

    The wall is a surface, so there is no radial strain: that needs a second wall.

    Parameters
    ----------
    sequence : MeshSequence
        Errors of positions are its own `uncertainty`; without one, the residual from few smooth
        functions.
    template : Template
        Of this sequence, with natural coordinates.
    end_diastole, end_systole : int
        Frames of the largest and the smallest volume.

    Returns
    -------
    Strain

    Raises
    ------
    TopologyError
        If the surface is not a cup, tube or sphere.
    ParameterError
        If the mesh has too few vertices.

    Notes
    -----
    Errors to first order: the gradient of each strain by the coefficients of the smooth surface,
    with the covariance of these. The residual of the functions is estimated from the difference of
    a coarser set beyond noise, the width of a level from that of narrower bands, and the choice of
    the frames of end diastole and end systole from the probability of other frames.
    """
    positions = sequence.vertices.astype(np.float64)
    # About a place of its own: what is far from zero has fewer digits.
    positions -= positions[0].mean(axis=0)
    known = sequence.uncertainty
    walls = smooth_walls(template, is_lattice=sequence.grid is not None)
    fine = WallMotion.of(positions, known, walls[0], end_diastole)
    curves, deviations = _measured(fine, measures_of(fine), end_diastole)
    if known is None:
        coarse = WallMotion.of(positions, known, walls[1], end_diastole)
        found = _measured(coarse, measures_of(coarse), end_diastole)
        left = _LEFT * _beyond((curves, deviations), found)
        levels = slice(len(DEFINITIONS), None)
        narrow = _measured(fine, _levels(fine, _BAND), end_diastole)
        meant = _beyond((curves[:, levels], deviations[:, levels]), narrow)
        left[:, levels] = np.hypot(left[:, levels], meant)
        left[:, 1] = np.hypot(left[:, 1], meant.mean(axis=1))
        deviations = np.hypot(deviations, left)
    else:
        _estimate_apex(fine, curves, deviations, end_diastole, end_systole)
    at_start, at_end = _choice(fine, curves, end_diastole, end_systole)
    deviations = np.hypot(deviations, at_start)
    deviations[end_diastole] = 0.0
    deviations[end_systole] = np.hypot(deviations[end_systole], at_end)
    names, segment, reason = _segments(template, sequence.facts, fine)
    by_segment, segment_deviations = _by_segment(fine, segment, names, end_diastole, end_systole)
    return Strain(
        names=NAMES,
        curves=curves,
        deviations=deviations,
        dyssynchrony=_dyssynchrony(fine, sequence),
        segments=names,
        by_segment=by_segment,
        segment_deviations=segment_deviations,
        end_diastole=end_diastole,
        end_systole=end_systole,
        layer="endocardium, as traced" if sequence.facts.cavity in _CAVITIES else "as traced",
        source="mesh" if known is None else known.source,
        reason=reason,
        notes=(
            *((Note.of("lines_from_pole_to_pole"),) if template.surface == SPHERE else ()),
            *(() if known is None else known.notes),
        ),
        sequence_id=sequence.id,
    )


def measures_of(motion: WallMotion) -> list[Measure]:
    """Lines and levels whose strains are the curves."""
    rows, columns = motion.places.shape
    lines = np.zeros((columns, rows, columns))
    lines[np.arange(columns), :, np.arange(columns)] = motion.places.weights
    if motion.wall.surface == CUP:
        # From base to base through the apex.
        lines = lines[: columns // 2] + lines[columns // 2 :]
    around = _levels(motion)
    return [
        Measure(LONGITUDINAL, lines.reshape(len(lines), -1)),
        Measure(CIRCUMFERENTIAL, np.concatenate([level.lines for level in around])),
        Measure(AREA, motion.weights.reshape(1, -1)),
        *around,
    ]


def _levels(motion: WallMotion, width: float = 1.0) -> list[Measure]:
    """Circumference of each third, or of a narrower band in it: less weight off its middle."""
    off = (3 * motion.places.ways - np.arange(len(LEVELS))[:, None] - 0.5) / width
    shares = np.maximum(1.0 - 4.0 * off**2, 0.0)
    return [
        Measure(CIRCUMFERENTIAL, (share[:, None] * motion.weights).reshape(1, -1))
        for share in shares
    ]


def _measured(motion: WallMotion, measures: list[Measure], start: int) -> tuple[Floats, Floats]:
    """Strain of each measure in each frame, and its standard deviation, (frames, measures)."""
    curves = [motion.strain(measure, start) for measure in measures]
    deviations = [
        [motion.deviation(measure, frame, start) for measure in measures]
        for frame in range(motion.n_frames)
    ]
    return np.stack(curves, axis=1), np.array(deviations)


def _estimate_apex(
    motion: WallMotion, curves: Floats, deviations: Floats, start: int, end: int
) -> None:
    """Estimate the apical level of a track, and with it the mean of the levels, in place.

    Near the apex a row that is off its height by a millimetre is longer or shorter by some percent.
    The difference from the mid level is therefore weighed against the usual one, by variances.
    """
    level, (apical, mid, basal) = len(DEFINITIONS), _levels(motion)
    lines = np.concatenate([apical.lines, mid.lines, basal.lines])
    expected = _APICAL * abs(curves[end, level + 1])
    for frame in range(motion.n_frames):
        if frame == start:
            continue
        apart = Measure(CIRCUMFERENTIAL, lines, np.array([1.0, -1.0, 0.0]))
        variance = motion.deviation(apart, frame, start) ** 2
        drawn = variance / (variance + expected**2 or 1.0)
        for place, share in ((level, 1.0), (1, 1.0 / len(LEVELS))):
            counted = np.array([1.0, 0.0, 0.0]) if share == 1.0 else np.full(len(LEVELS), share)
            counted += share * drawn * np.array([-1.0, 1.0, 0.0])
            measure = Measure(CIRCUMFERENTIAL, lines, counted)
            curves[frame, place] = motion.strain(measure, start)[frame]
            own = motion.deviation(measure, frame, start)
            deviations[frame, place] = np.hypot(own, share * drawn * expected)


def _beyond(one: tuple[Floats, Floats], other: tuple[Floats, Floats]) -> Floats:
    """Difference of two measurements of the same data beyond noise, (frames, measures).

    With the sign of the difference. The less precise of both contains the noise of the other and
    more, so variances differ by that of the difference.
    """
    (a, by_a), (b, by_b) = one, other
    squares = np.maximum((a - b) ** 2 - np.abs(by_a**2 - by_b**2), 0.0)
    return np.asarray(np.copysign(np.sqrt(squares), a - b))


def _choice(motion: WallMotion, curves: Floats, start: int, end: int) -> tuple[Floats, Floats]:
    """Deviation of strain, (measures,), from the choice of each of two frames.

    Each other frame counts by the probability that its volume, and not the chosen one's, is the
    largest or the smallest.
    """
    everywhere = np.zeros(len(motion.places.s), dtype=np.int64)
    volumes, gradients = segment_volumes(motion, everywhere, 1)
    volumes, variances = volumes[:, 0], volume_variances(motion, gradients)[:, 0]
    found = []
    for chosen, sign in ((start, 1.0), (end, -1.0)):
        apart = np.sqrt(np.maximum(variances + variances[chosen], np.finfo(np.float64).tiny))
        chances = scipy.special.ndtr(sign * (volumes - volumes[chosen]) / apart)
        squares = (curves - curves[chosen]) ** 2
        found.append(np.sqrt(chances @ squares / chances.sum()))
    return found[0], found[1]


def _by_segment(
    motion: WallMotion, segment: Ints, names: tuple[str, ...], start: int, end: int
) -> tuple[Floats, Floats]:
    """Strain of each segment in each frame, and its standard deviation at end systole."""
    values = np.full((motion.n_frames, len(names), len(DIRECTIONS)), np.nan)
    deviations = np.full((len(names), len(DIRECTIONS)), np.nan)
    for k in set(segment.tolist()) - {-1}:
        share = np.where(segment == k, motion.weights.ravel(), 0.0)[None]
        for d, kind in enumerate(DIRECTIONS):
            measure = Measure(kind, share)
            values[:, k, d] = motion.strain(measure, start)
            deviations[k, d] = motion.deviation(measure, end, start)
    return values, deviations


def _dyssynchrony(motion: WallMotion, sequence: MeshSequence) -> Figure | None:
    """Index of the 16 segments; of 16 sectors like them if the anterior wall is unknown."""
    if motion.wall.surface != CUP:
        return None
    volumes, gradients = segment_volumes(motion, sectors_of(motion), N_SECTORS)
    variances, is_track = volume_variances(motion, gradients), sequence.uncertainty is not None
    found = dyssynchrony(volumes, phases_of(sequence), variances, is_smooth=is_track)
    return None if found is None else Figure(*found)


def _segments(
    template: Template, facts: mesh.Facts, motion: WallMotion
) -> tuple[tuple[str, ...], Ints, str]:
    """Return the segment of each place."""
    wall, places = motion.wall, motion.places
    if wall.surface != CUP:
        reason = "Segments are defined for a cup, from apex to base."
        return RINGS, np.full(len(places.s), -1), reason
    reference = places.values @ (wall.projector @ template.vertices)
    return at_places(template, facts, np.repeat(places.ways, places.shape[1]), reference)


@shown("end_systole")
@dataclass(frozen=True, eq=False)
class Torsion:
    """Twist and shear of a wall since end diastole, degrees.

    Parameters
    ----------
    twist : (frames,) float64, degrees
        Rotation of the apical third of the wall about the axis from apex to base minus that of the
        basal third, right-handed: negative if the apex turns counterclockwise as seen from the
        apex.
    shear : (frames,) float64, degrees
        Mean change of the angle between lines along and around the wall, from circumferential
        towards longitudinal.
    twist_deviations, shear_deviations : (frames,) float64, degrees
        Standard deviation of both.
    end_diastole, end_systole : int
    """

    twist: Floats
    shear: Floats
    twist_deviations: Floats
    shear_deviations: Floats
    end_diastole: int
    end_systole: int


def torsion(
    sequence: MeshSequence, template: Template, end_diastole: int, end_systole: int
) -> Torsion:
    """Measure twist and shear of a wall.

    Parameters
    ----------
    sequence : MeshSequence
        Its facts state that its vertices follow the tissue.
    template : Template
    end_diastole, end_systole : int

    Raises
    ------
    ParameterError
        If it is not stated that the vertices follow the tissue, or there are too few.
    TopologyError
        If the surface is not a cup.
    """
    if sequence.facts.tracking != "material":
        raise errors.ParameterError(
            "Torsion and shear need points that follow the tissue; it is not stated whether these "
            "do.",
            remedy="Set the fact tracking=material if they do (tagging, feature tracking).",
        )
    if template.surface != CUP or template.landmarks is None:
        raise errors.TopologyError(
            "Torsion is defined about the axis of a ventricle, from apex to base.",
            remedy="Set topology=cup if the surface is a ventricle's wall.",
        )
    positions = sequence.vertices.astype(np.float64)
    positions -= positions[0].mean(axis=0)
    known = sequence.uncertainty
    wall, _ = smooth_walls(template, is_lattice=sequence.grid is not None)
    motion = WallMotion.of(positions, known, wall, end_diastole)
    twists = _twists(motion, template.landmarks.axis, end_diastole)
    shears = _shears(motion, end_diastole)
    return Torsion(
        twist=np.degrees(twists[0]),
        shear=np.degrees(shears[0]),
        twist_deviations=np.degrees(twists[1]),
        shear_deviations=np.degrees(shears[1]),
        end_diastole=end_diastole,
        end_systole=end_systole,
    )


def _twists(motion: WallMotion, axis: Floats, start: int) -> tuple[Floats, Floats]:
    """Twist of each frame and its standard deviation, radians.

    A ring's rotation is the angle of S = sum z conj(z0), z the position of its points about their
    mean across the axis, as complex numbers.
    """
    rows, columns = motion.places.shape
    grid = rows, columns, motion.n_frames, 3
    x = np.tensordot(motion.places.values, motion.coefficients, axes=1).reshape(grid)
    across = np.linalg.svd(axis[None])[2][1:]
    across[1] *= np.sign(np.cross(*across) @ axis)
    z = (x - x.mean(axis=1, keepdims=True)) @ (across[0] + 1j * across[1])
    third = np.minimum((3 * motion.places.ways).astype(int), 2)
    angles, gradients = [], []
    for part, sign in ((0, 1.0), (2, -1.0)):
        weights = np.where(third[:, None] == part, motion.weights, 0.0)
        S = np.einsum("rc,rcf,rc->f", weights, z, z[:, :, start].conj())
        angles.append(sign * np.angle(S))
        turned = sign * weights[:, :, None] * S.conj() * z[:, :, start, None].conj()
        turned /= np.abs(S) ** 2
        # Im(turned dz), dz = (e1 + i e2) . dx.
        gradients.append(turned.imag[..., None] * across[0] + turned.real[..., None] * across[1])
    total = np.sum(gradients, axis=0).reshape(rows * columns, motion.n_frames, 3)
    by_coefficients = np.tensordot(motion.places.values.T, total, axes=1)
    return np.sum(angles, axis=0), _errors(motion, by_coefficients, start)


def _shears(motion: WallMotion, start: int) -> tuple[Floats, Floats]:
    """Mean shear of each frame and its standard deviation, radians."""
    a, b = motion.slopes.along, motion.slopes.around
    sizes = [np.linalg.norm(x, axis=2, keepdims=True) for x in (a, b)]
    units = [x / np.where(size > 0, size, 1.0) for x, size in zip((a, b), sizes, strict=True)]
    cosine = (units[0] * units[1]).sum(axis=2, keepdims=True)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 1e-12))
    weights = motion.weights.reshape(-1, 1)
    angles = (weights * np.arcsin(np.clip(cosine[..., 0], -1.0, 1.0))).sum(axis=0)
    total = np.zeros((motion.places.values.shape[1], motion.n_frames, 3))
    for own, other, size, shapes in (
        (units[0], units[1], sizes[0], motion.places.along),
        (units[1], units[0], sizes[1], motion.places.around),
    ):
        slope = (other - cosine * own) / (sine * np.where(size > 0, size, 1.0))
        total += np.tensordot(shapes.T, weights[:, :, None] * slope, axes=1)
    return angles - angles[start], _errors(motion, total, start)


def _errors(motion: WallMotion, gradients: Floats, start: int) -> Floats:
    """Return standard deviations of gradients (functions, frames, 3), for independent frames."""
    variances = np.array(
        [motion.variance(gradients[:, frame], frame) for frame in range(motion.n_frames)]
    )
    deviations = np.sqrt(variances + variances[start])
    deviations[start] = 0.0
    return np.asarray(deviations, dtype=np.float64)
