"""Volume over time and ejection fraction, from the signature of a surface."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from modalmotion import errors, mesh
from modalmotion.arguments.checking import Plotted
from modalmotion.clinical.volume_curve import Fraction, VolumeCurve, volume_deviations
from modalmotion.mesh import alignment, facts
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.modes.topologies import CUP, PLANE
from modalmotion.notes import Note
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import Floats, Ints, counted, numeral, shown, with_article
from modalmotion.signature import fit, making, normal_displacements, reconstruction
from modalmotion.template import Template, body_frame

# Of the cube of the size: a surface that encloses less is a sheet, to rounding.
_NOTHING: Final = 1e-9

# Cubes of sizes beyond these overflow or vanish.
_SMALLEST: Final = 1e-90
_LARGEST: Final = 1e90

# Volumes of ventricles, in ml, from less than a mouse's to more than an elephant's.
_MOUSE: Final = 1e-3
_ELEPHANT: Final = 2e4

# Of a heartbeat, in s: 20 a minute.
_LONGEST: Final = 3.0

# Rounding of one triangle's term and of its place in the sum, in units of eps.
_ROUNDING: Final = 64.0


@shown(
    "stated.fraction",
    "stated.share:%",
    "stroke_volume:volume_unit",
    "n_amplitudes",
    "n_openings",
    "sequence_id",
)
@dataclass(frozen=True, eq=False)
class ClinicalReadouts(Plotted):
    """Read-outs of the volume that a surface encloses, over time.

    Parameters
    ----------
    curve : VolumeCurve
        From the signature's amplitudes and the reference shape, with a bound on the error of
        leaving out all other modes.
    mesh_curve : VolumeCurve
        Of the frames as sent; its bounds are those of rounding.
    times : (frames,) float64, s, or None
    unit : str or None
        Of lengths; volumes are in its cube.
    n_amplitudes : int
        Per frame.
    n_openings : int
        Of the surface, each capped by a fan to the mean of its vertices.
    sequence_id, template_id : str
    notes : tuple of Note
        Caveats for the user.
    is_tracked : bool
        Whether the surface was tracked, and its own errors are known.
    """

    curve: VolumeCurve
    mesh_curve: VolumeCurve
    times: Floats | None
    unit: str | None
    n_amplitudes: int
    n_openings: int
    sequence_id: str
    template_id: str
    notes: tuple[Note, ...]
    is_tracked: bool = False

    @property
    def stated(self) -> VolumeCurve:
        """The curve to report: for a track that of its own surfaces, whose errors are known."""
        return self.mesh_curve if self.is_tracked else self.curve

    @property
    def ejection_fraction(self) -> float | None:
        """Percent; None if it is not known that the surface is a cavity: see `stated.share`."""
        return self.stated.ejection_fraction

    @property
    def stroke_volume(self) -> float:
        """Largest minus smallest volume, in `volume_unit`."""
        return self.stated.stroke_volume * self.shown_in

    @property
    def millilitres(self) -> float:
        """Volume of one cubed length unit in ml.

        Raises
        ------
        ParameterError
            If the length unit is unknown.
        """
        if self.unit is None:
            raise errors.ParameterError(
                "The length unit is unknown, so volumes cannot be given in ml.",
                remedy="Give the unit of the sequence; the ejection fraction needs none.",
            )
        return millilitres_in(self.unit)

    @property
    def volume_unit(self) -> str:
        """Unit that volumes are best shown in: ml, or the cube of an unknown length unit."""
        return "cubed length units" if self.unit is None else "ml"

    @property
    def shown_in(self) -> float:
        """Factor from the cubed length unit to `volume_unit`."""
        return 1.0 if self.unit is None else self.millilitres


def millilitres_in(unit: str) -> float:
    """Return the volume of a cube with sides of one length unit, in ml."""
    return MM_PER_UNIT[unit] ** 3 / 1000.0


def clinical_readouts(
    signature: making.ModalSignature, sequence: MeshSequence, *, template: Template | None = None
) -> ClinicalReadouts:
    """Volume over time and ejection fraction from a signature, with their bounds.

    The ratio is called ejection fraction if a cavity is stated (`Facts.cavity`), or the surface is
    a cup and nothing else is stated; otherwise volume change.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from: its reference is the shape that amplitudes deform, and its
        frames are what the bound is measured against.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Returns
    -------
    ClinicalReadouts
        The largest volume is positive, for either winding.

    Raises
    ------
    TopologyError
        If the surface encloses nothing: a curve, a sheet, several pieces, a one-sided surface.
    ParameterError
        If the sequence is another, if the signature is of times between its frames, or if
        cubes of its size overflow or vanish.

    Notes
    -----
    The volume is that of the triangles, with each opening capped by a fan to the mean of its
    vertices. The bound of a frame is ``|V(signature) - V(frame)|``, measured, plus a bound on
    rounding; those of derived figures follow by interval arithmetic. Intervals also include two
    standard deviations: from the errors of a track, or from the noise of the vertices, which is
    their residual from a smooth wall.
    """
    used = reconstruction.fitted_on(signature, sequence, template)
    basis = fit.make_basis(used, signature.modes)
    if signature.n_frames != sequence.n_frames:
        raise errors.ParameterError(
            f"The signature has {signature.n_frames} frames, its sequence {sequence.n_frames}: "
            "so bounds cannot be measured between frames.",
            remedy="Give the signature at the frames of the sequence.",
        )
    cavity = _cavity(used)
    start = alignment.reference_positions(sequence, signature.parameters.reference)
    corner = start[cavity.faces[0, 0]]
    corners = np.unique(cavity.faces)
    scale = _size(start[corners] - corner)
    rest = (start - corner) / scale
    rest[used.isolated] = 0.0
    scaled = replace(signature, amplitudes=signature.amplitudes / scale)
    volumes, sizes = np.empty(signature.n_frames), np.empty(signature.n_frames)
    own, own_sizes = np.empty(signature.n_frames), np.empty(signature.n_frames)
    for part, positions in superposed_positions(scaled, used, basis, rest):
        volumes[part], sizes[part] = _measured(cavity, corners, positions)
        frames = sequence.vertices[part].astype(np.float64)
        own[part], own_sizes[part] = _measured(
            cavity, corners, (frames - frames[:, cavity.faces[0, :1]]) / scale
        )
    largest = own[np.abs(own).argmax()]
    if not abs(largest) > _NOTHING:
        raise errors.TopologyError(
            "The surface encloses no volume: it is flat, or the volumes of its parts cancel.",
            remedy="Send the closed or cup-shaped wall of a cavity.",
        )
    sign = np.sign(largest)
    name = _name_of_share(signature, sequence)
    is_positive, is_own_positive = (sign * volumes > 0).all(), (sign * own > 0).all()
    moves = signature.n_frames > 1
    n_terms = len(cavity.faces) + sum(map(len, cavity.openings))
    rounding = _ROUNDING * np.finfo(np.float64).eps * n_terms
    own_bounds = rounding * own_sizes**3
    bounds = np.abs(volumes - own) + rounding * sizes**3 + own_bounds
    cube = scale**3
    known = sequence.uncertainty
    muscle = 0.0 if known is None else known.papillary_volume
    deviations = volume_deviations(sequence, used, cavity)
    correlation = 0.0 if known is None else known.volume_correlation
    return ClinicalReadouts(
        curve=VolumeCurve(
            sign * volumes * cube - muscle,
            bounds * cube,
            name if moves and is_positive and is_own_positive else None,
            deviations,
            correlation,
        ),
        mesh_curve=VolumeCurve(
            sign * own * cube - muscle,
            own_bounds * cube,
            name if moves and is_own_positive else None,
            deviations,
            correlation,
        ),
        times=signature.times,
        unit=signature.unit,
        n_amplitudes=3 * len(signature.modes),
        n_openings=len(cavity.openings),
        sequence_id=signature.sequence_id,
        template_id=signature.template_id,
        notes=(
            *_of_share(sign * own, sign * volumes, name),
            *_of_recording(sequence, signature.unit, abs(largest) * cube, name),
        ),
        is_tracked=known is not None and known.volumes is not None,
    )


def _name_of_share(signature: making.ModalSignature, sequence: MeshSequence) -> Fraction:
    cavity = sequence.facts.cavity
    if cavity == facts.UNKNOWN:
        cavity = signature.facts.cavity
    is_cavity = signature.topology == CUP if cavity == facts.UNKNOWN else cavity != "none"
    return Fraction.EJECTION_FRACTION if is_cavity else Fraction.VOLUME_CHANGE


def _cavity(template: Template) -> mesh.Cavity:
    if template.surface == PLANE:
        raise errors.TopologyError(
            "The surface is a plane, a sheet that encloses nothing.",
            remedy="Send the wall of a cavity, or state its topology (cup) if this is one.",
        )
    return mesh.cavity_of(template.faces, template.n_vertices)


def _size(offsets: Floats) -> float:
    """Power of two near the size of the surface."""
    size = float(np.abs(offsets).max())
    if size == 0.0:
        raise errors.TopologyError(
            "All vertices of the reference coincide, so it encloses nothing.",
            remedy="Name a reference frame in which the surface is spread out.",
        )
    if not _SMALLEST < size < _LARGEST:
        raise errors.ParameterError(
            f"The surface is {size:.1g} in size; its volume overflows or underflows in double "
            "precision.",
            remedy="Use a larger or smaller unit, with numbers near 1.",
        )
    return power_of_two(size)


def _measured(cavity: mesh.Cavity, used: Ints, positions: Floats) -> tuple[Floats, Floats]:
    """Volumes about a vertex, and the distance from it to the farthest vertex."""
    offsets = positions - positions[:, cavity.faces[0, :1]]
    squares = np.einsum("fnd,fnd->fn", offsets, offsets)
    return cavity.volume(positions), np.sqrt(squares[:, used].max(axis=1))


def _of_recording(
    sequence: MeshSequence, unit: str | None, volume: float, name: Fraction
) -> Iterator[Note]:
    """Note a volume that no heart has, a track and its caveats, and a beat that is none."""
    # Lengths ten times too large make it a thousandfold.
    if unit is not None and not _MOUSE <= volume * millilitres_in(unit) <= _ELEPHANT:
        amount = numeral(volume * millilitres_in(unit), 1)
        yield Note.of("volume_unlikely", volume=amount, unit=unit)
    known = sequence.uncertainty
    if known is not None and known.volumes is not None:
        convention = ", papillary muscles subtracted" if known.papillary_volume else ""
        yield Note.of("tracked", source=known.source, convention=convention)
        yield from known.notes
    beat = sequence.facts.period or sequence.span or 0.0
    if name == Fraction.EJECTION_FRACTION and beat > _LONGEST:
        yield Note.of("beat_too_long", seconds=beat)


def _of_share(own: Floats, volumes: Floats, name: Fraction) -> tuple[Note, ...]:
    if len(own) == 1:
        return (Note.of("nothing_ejected"),)
    for curve, what, remedy in (
        (own, "the surface", "Send the sequence without this frame."),
        (volumes, "the surface superposed from the modes", "Ask for more modes."),
    ):
        inverted = np.flatnonzero(curve <= 0)
        if inverted.size:
            note = Note.of(
                "inside_out",
                frames=counted(inverted.size, "frame"),
                first=inverted[0],
                surface=what,
                share=with_article(name.words),
                remedy=remedy,
            )
            return (note,)
    if name == Fraction.VOLUME_CHANGE:
        return (Note.of("cavity_unknown"),)
    return ()


# Floats of positions in memory at once.
_BLOCK: Final = 500_000


def superposed_positions(
    signature: making.ModalSignature, template: Template, basis: fit.Basis, rest: Floats
) -> Iterator[tuple[slice, Floats]]:
    """Positions in the frame of the reference, without rotation, some frames at a time.

    Parameters
    ----------
    signature : ModalSignature
    template : Template
    basis : Basis
        Of the signature's modes on the template.
    rest : (vertices, 3) float64
        Reference positions near the origin, in a unit in which they are of size 1.

    Yields
    ------
    frames : slice
    positions : (n, vertices, 3) float64
        In the unit of `rest`, in which the caller passes the amplitudes.
    """
    n_frames, n_vertices = signature.n_frames, len(rest)
    step = max(1, _BLOCK // (3 * n_vertices))
    if signature.kind == making.SignatureKind.NORMAL_DISPLACEMENT:
        # Normal displacements have no affine part that could be separated.
        normals, _ = normal_displacements.normal_reference(template, rest)
        for first in range(0, n_frames, step):
            part = slice(first, first + step)
            u = body_frame.from_local(
                _superposed(signature.amplitudes[part], basis.shapes.T), normals
            )
            yield part, u + rest
        return
    is_local = signature.parameters.components != body_frame.Components.CARTESIAN
    frames = body_frame.local_frames(template) if is_local else None
    q = body_frame.unit_coordinates(rest, template.weights)
    of_maps = _amplitudes_of_maps(basis, q, frames)
    a = signature.amplitudes.reshape(n_frames, -1)
    # a ~ c D by least squares, over the maps that the amplitudes determine
    U, S, Vt = np.linalg.svd(of_maps, full_matrices=False)
    seen = S > body_frame.HELD
    c = a @ (Vt[seen].T / S[seen] @ U[:, seen].T)
    remaining = (a - c @ of_maps).reshape(signature.amplitudes.shape)
    A, axes = c.reshape(n_frames, -1, 3), np.ascontiguousarray(q.T)
    for first in range(0, n_frames, step):
        part = slice(first, first + step)
        u = _superposed(remaining[part], basis.shapes.T)
        if frames is not None:
            u = body_frame.from_local(u, frames)
        # x + A q + sum_p a_p phi_p
        u += _superposed(A[part], axes)
        u += rest
        yield part, u


def _superposed(coefficients: Floats, rows: Floats) -> Floats:
    """Sum of fields times coefficients, (frames, vertices, n)."""
    f, m, n = coefficients.shape
    by_direction = np.ascontiguousarray(coefficients.transpose(0, 2, 1)).reshape(n * f, m)
    return (by_direction @ rows).reshape(f, n, -1).transpose(0, 2, 1)


def _amplitudes_of_maps(basis: fit.Basis, q: Floats, frames: Floats | None) -> Floats:
    """Amplitudes of the motions by coordinate i along direction j, (3 i + j, 3 modes) float64."""
    rows = []
    for coordinate in q.T:
        for direction in range(3):
            u = np.zeros((1, 3, len(q)))
            u[0, direction] = coordinate
            if frames is not None:
                u = body_frame.to_local(u, frames)
            rows.append(fit.project(basis, u.transpose(0, 2, 1)).ravel())
    return np.array(rows)


# Points between two frames at which a spline's slope is evaluated.
_FINE: Final = 32

# A spline's peak is off by so many times its distance from the chords' at most, and by so many
# times the square of that as a share of it: chords are off by O(h^2), splines by O(h^3) at most.
_FAR: Final = 1.5
_NEAR: Final = 6.0


@shown("heart_rate", "cardiac_output", "peak_ejection_rate", "peak_filling_rate")
@dataclass(frozen=True)
class Rates:
    """Rates of a beating cavity; volumes in the read-outs' `volume_unit`.

    Parameters
    ----------
    peak_ejection_rate, peak_filling_rate : float, volume per s
        Largest fall and rise of the volume, of a cubic spline through the frames; both positive.
    ejection_bound, filling_bound : float, volume per s
        Bounds on the error of the rates: from the volumes' own bounds, and between frames.
    ejection_frame, filling_frame : int
        Frames nearest to the peaks.
    heart_rate : float or None, beats per minute
        None if no period is given.
    cardiac_output : float or None, volume per minute
        Stroke volume times heart rate.
    output_range : tuple of float or None, volume per minute
        Interval of the true cardiac output.
    """

    peak_ejection_rate: float
    peak_filling_rate: float
    ejection_bound: float
    filling_bound: float
    ejection_frame: int
    filling_frame: int
    heart_rate: float | None
    cardiac_output: float | None
    output_range: tuple[float, float] | None


def rates_of(readouts: ClinicalReadouts, period: float | None = None) -> Rates:
    """Derive rates from a volume over time.

    Parameters
    ----------
    readouts : ClinicalReadouts
    period : float, s, optional
        Of the heartbeat. The frame after the last is then the first, unless it repeats it.

    Raises
    ------
    ParameterError
        If the times are unknown, or there are fewer than three frames.
    """
    times, factor = readouts.times, readouts.shown_in
    if times is None or len(times) < 3:
        raise errors.ParameterError(
            "Rates of emptying and filling need the times of at least three frames.",
            remedy="Give the times or the interval of the frames (--frame-interval).",
        )
    volumes, bounds = readouts.curve.volumes * factor, readouts.curve.bounds * factor
    fall, rise = _peaks(times, volumes, bounds, period)
    heart_rate = output = interval = None
    if period is not None:
        heart_rate = 60.0 / period
        output = readouts.curve.stroke_volume * factor * heart_rate
        low, high = readouts.curve.stroke_range
        interval = (low * factor * heart_rate, high * factor * heart_rate)
    (ejection, ejection_bound, ejected), (filling, filling_bound, filled) = fall, rise
    return Rates(
        *(ejection, filling, ejection_bound, filling_bound, ejected, filled),
        *(heart_rate, output, interval),
    )


def _peaks(
    times: Floats, volumes: Floats, bounds: Floats, period: float | None
) -> list[tuple[float, float, int]]:
    """Largest fall and rise, each with its bound and frame; periodic if the cycle is closed."""
    n = len(times)
    t, step = times, float(times[-1] - times[0]) / (n - 1)
    weights = np.eye(n)
    closes = period is not None and period > t[-1] - t[0] - 0.5 * step
    if closes and period is not None:
        if period < t[-1] - t[0] + 0.5 * step:
            # The last frame repeats the first: one volume, measured twice.
            t, weights = t[:-1], weights[:-1]
            weights[0, -1] = weights[0, 0] = 0.5
        t = np.append(t, t[0] + period)
        weights = np.concatenate([weights, weights[:1]])
    # Rates are sums of volumes: (times, frames) weights.
    spline = scipy.interpolate.CubicSpline(t, weights, bc_type="periodic" if closes else "natural")
    fine = np.interp(np.arange(_FINE * (len(t) - 1) + 1) / _FINE, np.arange(len(t)), t)
    slopes = spline(fine, 1)
    # The slope at an open end depends on the end condition.
    knots = scipy.interpolate.CubicSpline(t, weights, bc_type="not-a-knot")
    other = slopes if closes else knots(fine, 1)
    rates, others = slopes @ volumes, other @ volumes
    chords = _central(t, weights @ volumes, is_closed=closes)
    found = []
    for sign in (-1.0, 1.0):
        at = int(np.argmax(sign * rates))
        rate = max(0.0, float(sign * rates[at]))
        beside = abs(rate - max(0.0, float((sign * chords).max())))
        between = beside * min(_FAR, _NEAR * beside / rate) if rate > 0.0 else 0.0
        between += abs(float((sign * others).max()) - float((sign * rates).max()))
        frame = int(np.argmin(np.abs(t - fine[at])))
        bound = float(np.abs(slopes[at]) @ bounds) + between
        found.append((rate, bound, 0 if closes and frame == len(t) - 1 else frame))
    return found


def _central(t: Floats, v: Floats, *, is_closed: bool) -> Floats:
    """Slopes of chords between the neighbours of each time; at open ends from one side."""
    if is_closed:
        t = np.concatenate([[t[0] - (t[-1] - t[-2])], t])
        v = np.concatenate([v[-2:-1], v])
    else:
        t, v = (np.concatenate([x[:1], x, x[-1:]]) for x in (t, v))
    slopes: Floats = (v[2:] - v[:-2]) / (t[2:] - t[:-2])
    return slopes
