"""Surfaces superposed from a signature, at its frames or at any time."""

from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

import numpy as np
import scipy

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.mesh.alignment import Rotations, reference_positions
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import Floats, Ints, shown
from modalmotion.signature import making
from modalmotion.signature.normal_displacements import normal_reference
from modalmotion.signature.value import LENGTHS_OF_FRAMES
from modalmotion.template import Template
from modalmotion.template.body_frame import Components, from_local, local_frames
from modalmotion.template.template import shapes_of


def reconstruct(
    signature: making.ModalSignature,
    sequence: MeshSequence,
    frames: Ints | list[int] | None = None,
    *,
    template: Template | None = None,
) -> Floats:
    """Positions that the signature's modes and rotations represent.

    Normal displacements move the reference along its normals: the vertices are then points of the
    surface, and not those of the sequence.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from: its reference frame gives the shape to deform.
    frames : (n,) int, optional
        Numbers of the frames; all by default.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Returns
    -------
    (n, vertices, 3) float64, unit of the sequence

    Raises
    ------
    ParameterError
        If the sequence is not the one the signature was made from.
    """
    parameters, used = signature.parameters, fitted_on(signature, sequence, template)
    start = reference_positions(sequence, parameters.reference)
    rows = slice(None) if frames is None else np.asarray(frames)
    drift = signature.translations[rows][:, None]
    # (2) u = sum_p a_p phi_p, of Nastar (1994)
    u = shapes_of(signature.modes, used) @ signature.amplitudes[rows]
    centre = used.weights @ start
    if parameters.kind == making.SignatureKind.NORMAL_DISPLACEMENT:
        directions, centre = normal_reference(used, start)
        # Displacements contain the path of the centroid, normal displacements do not.
        u = from_local(u, directions) + drift
    elif parameters.components != Components.CARTESIAN:
        u = from_local(u, local_frames(used))
    # R (x - c + u - d) + c + d, so written that what does not move stays to the last bit.
    turns = (signature.rotations.matrices[rows] - np.eye(3)).transpose(0, 2, 1)
    return np.asarray(start + u + (start - centre + u - drift) @ turns)


def fitted_on(
    signature: making.ModalSignature, sequence: MeshSequence, template: Template | None = None
) -> Template:
    """Give the template that a signature's amplitudes belong to.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Raises
    ------
    ParameterError
        If the sequence is not the one the signature was made from.
    """
    if sequence.id != signature.sequence_id:
        raise ParameterError(
            "The signature was made from another sequence.",
            remedy="Give the sequence whose id the signature names.",
        )
    resolved = making.resolve_sequence(sequence, signature.parameters)
    return making.resolve_template(resolved, signature.parameters, template)


Interpolation: TypeAlias = Literal["cubic", "linear"]

_INTERPOLATIONS: Final[tuple[Interpolation, ...]] = ("cubic", "linear")

# Coordinates that the interpolation is chosen by; and frames of which one can be left out.
_MOST_CHOSEN: Final = 1500
_LEAST_FRAMES: Final = 5

# By how much squares of errors grow where frames stand twice as far apart, of motion that is no
# smoother than recorded ones are: a polynomial's would grow by the square of that.
_GROWTH: Final[dict[Interpolation, float]] = {"cubic": 2.0**4, "linear": 2.0**2}


@shown("sequence", "interpolation", "rms_deviations")
@dataclass(frozen=True, eq=False)
class Resampled:
    """Surfaces at chosen phases.

    Parameters
    ----------
    sequence : MeshSequence
        With times where the recording has them.
    phases : (n,) float64
        Share of the cycle since the first frame, 0 to 1.
    deviations : (n, vertices) float64, length unit
        Standard deviation of each coordinate of a vertex from what a frame there would show; 0 at
        the frames themselves.
    interpolation : {"cubic", "linear"}
        How vertices go between frames: what foresees frames that are left out better.
    """

    sequence: MeshSequence
    phases: Floats
    deviations: Floats
    interpolation: Interpolation

    @property
    def rms_deviations(self) -> Floats:
        """RMS over the vertices, (n,) float64, length unit."""
        return np.asarray(np.sqrt((self.deviations**2).mean(axis=1)))


def resample(sequence: MeshSequence, phases: Floats | list[float] | float | int) -> Resampled:
    """Give the surface at any phase of its cycle.

    Parameters
    ----------
    sequence : MeshSequence
        One cycle. Its stated period is the cycle's length; without one the frame after the last is
        the first, a mean step later.
    phases : int, float or (n,) array_like
        Of a whole number as many phases in even steps, from the first frame on; else shares of the
        cycle, 0 to 1.

    Returns
    -------
    Resampled

    Raises
    ------
    ShapeError
        Of fewer than five frames.
    ParameterError
        If a phase is none.

    Notes
    -----
    Squares of errors are those that leaving out each frame makes, less the part of them that falls
    where frames stand half as far apart: leaving out three of four tells it from noise.
    """
    n_frames = sequence.n_frames
    if n_frames < _LEAST_FRAMES:
        raise ShapeError(
            f"The recording has {n_frames} frames; phases between them need {_LEAST_FRAMES}.",
            remedy="Send more frames of the cycle.",
        )
    at = _phases(phases)
    times = np.arange(n_frames, dtype=np.float64) if sequence.times is None else sequence.times
    span = float(times[-1] - times[0])
    stated = None if sequence.times is None else sequence.facts.period
    period = stated or span * n_frames / (n_frames - 1)
    own = (times - times[0]) / period
    # A last frame that repeats the first is the first.
    kept = own < 1.0 - 0.5 / n_frames
    x = sequence.vertices[kept].astype(np.float64).reshape(int(kept.sum()), -1)
    own = own[kept]
    some = x[:, :: max(1, x.shape[1] // _MOST_CHOSEN)]
    errors = {
        interpolation: _left_out(own, some, interpolation, 1) for interpolation in _INTERPOLATIONS
    }
    interpolation = min(_INTERPOLATIONS, key=lambda one: float(np.square(errors[one]).mean()))
    left = _left_out(own, x, interpolation, 1)
    farther = float(np.square(_left_out(own, x, interpolation, 2)).mean())
    positions = _between(own, x, interpolation, at)
    vertices = positions.reshape(len(at), sequence.n_vertices, 3)
    moved = replace(
        sequence,
        vertices=vertices,
        times=None if sequence.times is None else times[0] + at * period,
        uncertainty=None,
    )
    here, growth = float(np.square(left).mean()), _GROWTH[interpolation]
    smooth = min(max(farther - here, 0.0) / (growth - 1.0), here)
    scale = 1.0 - smooth * (1.0 - 1.0 / growth) / here if here else 0.0
    return Resampled(moved, at, np.sqrt(scale) * _deviations(own, left, at), interpolation)


def _phases(phases: Floats | list[float] | float | int) -> Floats:
    if isinstance(phases, int) and phases > 1:
        return np.arange(phases, dtype=np.float64) / phases
    at = np.atleast_1d(np.asarray(phases, dtype=np.float64))
    if at.ndim != 1 or not len(at) or not ((at >= 0.0) & (at <= 1.0)).all() or (at != at).any():
        raise ParameterError(
            f"The phases are {str(phases)[:40]}.",
            remedy="Give shares of the cycle from 0 to 1, or a number of frames from 2 on.",
        )
    if (np.diff(at) <= 0).any():
        raise ParameterError(
            "The phases do not rise from one to the next.", remedy="Give each once, in order."
        )
    return at


def _between(own: Floats, x: Floats, interpolation: Interpolation, at: Floats) -> Floats:
    """Positions at phases, through those of the frames, round the cycle."""
    around, closed = np.append(own, own[0] + 1.0), np.concatenate([x, x[:1]])
    if interpolation == "cubic":
        # A periodic `make_interp_spline` solves for one coordinate after another: 60 times slower.
        spline = scipy.interpolate.CubicSpline(around, closed, bc_type="periodic")
    else:
        spline = scipy.interpolate.make_interp_spline(around, closed, k=1)
    return np.asarray(spline(own[0] + np.mod(at - own[0], 1.0)))


def _left_out(own: Floats, x: Floats, interpolation: Interpolation, reach: int) -> Floats:
    """Errors of frames foreseen from those at least `reach` away, (frames, coordinates)."""
    n = len(own)
    errors = np.empty_like(x)
    for frame in range(n):
        apart = np.abs((np.arange(n) - frame + n // 2) % n - n // 2)
        others = apart >= reach
        errors[frame] = x[frame] - _between(own[others], x[others], interpolation, own[[frame]])[0]
    return errors


def _deviations(own: Floats, left: Floats, at: Floats) -> Floats:
    """Errors of left-out frames as they are between frames, (phases, vertices)."""
    squares = np.square(left).reshape(len(own), -1, 3).mean(axis=2)
    total = float(squares.mean())
    if total == 0.0:
        return np.zeros((len(at), squares.shape[1]))
    # Of each frame and each vertex, as a product of both.
    by_frame, by_vertex = squares.mean(axis=1), squares.mean(axis=0) / total
    around = np.append(own, own[0] + 1.0)
    place = own[0] + np.mod(at - own[0], 1.0)
    before = np.clip(np.searchsorted(around, place, side="right") - 1, 0, len(own) - 1)
    share = (place - around[before]) / (around[before + 1] - around[before])
    mean = (by_frame[before] + by_frame[(before + 1) % len(own)]) / 2.0
    # Nothing at frames, all of it half-way between them.
    inner = 4.0 * share * (1.0 - share)
    return np.sqrt(np.outer(mean * inner, by_vertex))


def at_times(signature: making.ModalSignature, times: Floats) -> making.ModalSignature:
    """Trajectory of a signature at other times.

    Amplitudes follow cubic splines, rotations the shortest turn between frames. Errors and
    deviations are those of the frames nearest in time: what is between frames was not measured.

    Parameters
    ----------
    signature : ModalSignature
    times : (n,) float64, s
        Within the recording; frame numbers where the signature has no times.

    Returns
    -------
    ModalSignature
        With n frames.

    Raises
    ------
    ParameterError
        If `times` is empty, or one is outside the recording.
    """
    own = np.arange(signature.n_frames, dtype=np.float64)
    own = own if signature.times is None else signature.times
    instants = np.asarray(times, dtype=np.float64)
    outside = ~((instants >= own[0]) & (instants <= own[-1]))
    if instants.ndim != 1 or not len(instants) or outside.any():
        first = instants[outside][0] if instants.ndim == 1 and outside.any() else instants
        raise ParameterError(
            f"The time {first} was requested; the recording runs from {own[0]} to {own[-1]}.",
            remedy="Ask for times within the recording (frame numbers where it has no times).",
            details={"least": float(own[0]), "most": float(own[-1])},
        )
    nearest = np.abs(own[:, None] - instants).argmin(axis=0)
    rotations, exact = signature.rotations, own[nearest] == instants
    paths = [signature.amplitudes, signature.translations, rotations.matrices]
    found = [path[nearest] for path in paths]
    # At a frame the trajectory is the frame's own, to the last bit.
    if not exact.all():
        spline = scipy.interpolate.CubicSpline
        found[:2] = (spline(own, path, axis=0)(instants) for path in paths[:2])
        turns = scipy.spatial.transform.Rotation.from_matrix(rotations.matrices)
        found[2] = scipy.spatial.transform.Slerp(own, turns)(instants).as_matrix()
        for values, path in zip(found, paths, strict=True):
            values[exact] = path[nearest[exact]]
    deviations = signature.amplitude_deviations
    return replace(
        signature,
        amplitudes=found[0],
        translations=found[1],
        rotations=Rotations(found[2], rotations.is_determined[nearest]),
        **{name: getattr(signature, name)[nearest] for name in LENGTHS_OF_FRAMES},
        times=instants,
        amplitude_deviations=None if deviations is None else deviations[nearest],
    )
