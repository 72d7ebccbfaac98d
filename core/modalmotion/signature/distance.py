"""Distance between two modal signatures: |a - b| / |b| over amplitudes at the same phases."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.mesh import sequence, spring_modes
from modalmotion.representation import Floats, shown
from modalmotion.signature.making import ModalSignature
from modalmotion.template.body_frame import Components
from modalmotion.template.landmarks import WEAK

# The highest harmonics fitted to uneven times are dropped until the condition is below this.
_LARGEST_CONDITION: Final = 1e3

# Times that are even to this share of a step are taken as even.
_EVEN: Final = 1e-9


def signature_distance(a: Floats, b: Floats) -> float:
    """Distance of amplitudes from others, relative to these.

    Parameters
    ----------
    a, b : (frames, modes, 3) float64, the same length unit
        In the frame of the body and at the same phases: see `body_frame` and
        `resample_to_phase`. Where theta has no landmark, `theta_invariants` of them.

    Returns
    -------
    float
        |a - b| / |b|, 0 if both are zero and infinite if only b is.

    Raises
    ------
    ShapeError
        If their frames or modes differ.
    """
    if a.shape != b.shape or a.ndim != 3:
        raise ShapeError(
            f"Amplitudes of the shapes {a.shape} and {b.shape} cannot be compared.",
            remedy="Use the same modes, and resample both to the same phases.",
            details={"a": list(a.shape), "b": list(b.shape)},
        )
    scale = max(float(np.abs(a).max(initial=0.0)), float(np.abs(b).max(initial=0.0)))
    if scale == 0.0:
        return 0.0
    size = float(np.linalg.norm(b / scale))
    return float(np.linalg.norm((a - b) / scale)) / size if size > 0 else float("inf")


def resample_to_phase(
    amplitudes: Floats,
    n_phases: int,
    *,
    times: Floats | None = None,
    period: float | None = None,
    closed: bool = True,
) -> Floats:
    """Amplitudes at evenly spaced phases, for any frame rate.

    Parameters
    ----------
    amplitudes : (frames, modes, 3) float64
    n_phases : int
    times : (frames,) float64, s, optional
        Increasing; evenly spaced if they are left out.
    period : float, s, optional
        Of a closed cycle: from the first frame to its first repetition, which is not a frame.
        One even step beyond the last frame by default.
    closed : bool
        True for a cycle: trigonometric interpolation, by least squares where times are uneven.
        False for a movement with a beginning and an end, which become the first and the last
        phase: cubic splines.

    Returns
    -------
    (n_phases, modes, 3) float64
        The first phase is that of the first frame.

    Raises
    ------
    ParameterError
        If `n_phases` is below 1, or the period is shorter than the times.
    """
    n_frames = len(amplitudes)
    if n_phases < 1:
        raise ParameterError(
            f"{n_phases} phases were requested.", remedy="Ask for at least one phase."
        )
    if n_frames == 1:
        return np.repeat(amplitudes, n_phases, axis=0)
    at = np.arange(n_frames, dtype=np.float64) if times is None else times - times[0]
    if not closed:
        spline = scipy.interpolate.CubicSpline(at / at[-1], amplitudes, axis=0)
        return np.asarray(spline(np.linspace(0.0, 1.0, n_phases)))
    span = at[-1] * n_frames / (n_frames - 1) if period is None else period
    if not span > at[-1]:
        raise ParameterError(
            f"The period is {span}, but the frames span {at[-1]}.",
            remedy="Give the time from the first frame to its first repetition, which is not part "
            "of the sequence.",
        )
    phases = at / span
    even_phases = np.arange(n_phases) / n_phases
    flat = amplitudes.reshape(n_frames, -1)
    if np.abs(phases - np.arange(n_frames) / n_frames).max() < _EVEN / n_frames:
        if n_phases == n_frames:
            return amplitudes.copy()
        result = _trigonometric(flat, even_phases)
    else:
        result = _least_squares(flat, phases, even_phases)
    return result.reshape(n_phases, *amplitudes.shape[1:])


def theta_invariants(
    amplitudes: Floats, modes: spring_modes.Modes, components: Components = Components.CARTESIAN
) -> Floats:
    """Magnitudes that do not depend on where theta starts.

    Moving the zero of theta by phi multiplies the pair (cos, sin) of wavenumber p' by
    exp(i p' phi), and in the frame of the body turns the two directions across the axis by
    phi. So the pair's complex amplitudes along the axis, and of both senses of turning across
    it, keep their magnitudes.

    Parameters
    ----------
    amplitudes : (frames, modes, n) float64, length unit
        In the frame of the body, or radial, tangential, axial, or the only one of normal
        displacements.
    modes : Modes
        Whole pairs.
    components : Components

    Returns
    -------
    (frames, pairs, n) float64, length unit
        One for each wave vector, in the order of its cosine. Their squares add up to those of
        the amplitudes.

    Raises
    ------
    ParameterError
        If a pair is split.
    """
    cosines, sines = spring_modes.wave_pairs(modes)
    has_sine = sines >= 0
    if int(has_sine.sum()) != int(modes.is_sine.sum()):
        raise ParameterError(
            "A sine mode is present without its cosine.",
            remedy="Use modes in whole cosine-sine pairs.",
        )
    real = amplitudes[:, cosines]
    imaginary = np.where(has_sine[None, :, None], amplitudes[:, sines], 0.0)
    if components == Components.CYLINDRICAL or amplitudes.shape[2] == 1:
        return np.asarray(np.hypot(real, imaginary))
    x, y, z = np.moveaxis(real + 1j * imaginary, 2, 0)
    # |X + i Y|^2 + |X - i Y|^2 = 2 (|X|^2 + |Y|^2)
    one, other = np.abs(x + 1j * y) / np.sqrt(2), np.abs(x - 1j * y) / np.sqrt(2)
    return np.stack([one, other, np.abs(z)], axis=2)


def _trigonometric(values: Floats, targets: Floats) -> Floats:
    """Interpolate evenly spaced samples of a cycle exactly by harmonics."""
    n = len(values)
    coefficients = np.fft.rfft(values, axis=0) / n
    p = np.arange(len(coefficients))
    factor = np.where((p == 0) | (2 * p == n), 1.0, 2.0)[:, None]
    waves = np.exp(2j * np.pi * np.outer(targets, p))
    return np.asarray((waves @ (factor * coefficients)).real)


def _least_squares(values: Floats, phases: Floats, targets: Floats) -> Floats:
    """Fit harmonics to uneven samples, as many as they resolve."""
    for n_harmonics in range((len(phases) - 1) // 2, -1, -1):
        design = _harmonics(phases, n_harmonics)
        if n_harmonics == 0 or np.linalg.cond(design) <= _LARGEST_CONDITION:
            break
    coefficients = np.linalg.lstsq(design, values, rcond=None)[0]
    return np.asarray(_harmonics(targets, n_harmonics) @ coefficients)


def _harmonics(phases: Floats, n_harmonics: int) -> Floats:
    angles = 2 * np.pi * np.outer(phases, np.arange(1, n_harmonics + 1))
    return np.concatenate([np.ones((len(phases), 1)), np.cos(angles), np.sin(angles)], axis=1)


N_PHASES = 64
"""Number of phases at which trajectories are compared."""


@shown()
@dataclass(frozen=True)
class Comparison:
    """Distance of one signature from another.

    Parameters
    ----------
    distance : float
        |a - b| / |b| over the amplitudes in the frame of the body, at the same phases.
    uses_theta_zero : bool
        False where a zero of theta is not determined: then magnitudes of pairs are compared,
        and two motions that differ in direction alone are at distance 0.
    by_errors : float or None
        Distance that the stated deviations of both would make by themselves, the square root of
        its mean square: a distance no larger than it shows no difference. None if neither has
        deviations; of one that has none, none are counted.
    """

    distance: float
    uses_theta_zero: bool
    by_errors: float | None = None


def compare(a: ModalSignature, b: ModalSignature, *, closed: bool = True) -> Comparison:
    """Compare two signatures: of patients, of meshes, of recordings.

    Parameters
    ----------
    a, b : ModalSignature
        Of the same kind, with the same modes and components. Their units are taken into account
        where both are known.
    closed : bool
        Whether the trajectories are one turn of a cycle, whose frame after the last would be
        the first; False for a movement with a beginning and an end.

    Returns
    -------
    Comparison

    Raises
    ------
    ParameterError
        If the two are not of the same kind, modes or components, or only one unit is known.
    """
    if a.kind != b.kind:
        raise ParameterError(
            f"One signature is of the kind {a.kind}, the other of {b.kind}: displacements of "
            "points and normal displacements of a surface are not comparable.",
            remedy="Fit both with kind=normal_displacement, which works for every surface, or "
            "both with kind=material if the points of both follow the tissue.",
            details={"kinds": [a.kind.value, b.kind.value]},
        )
    if a.modes != b.modes or a.parameters.components != b.parameters.components:
        raise ParameterError(
            f"The signatures have different modes: {len(a.modes)} of a {a.surface}, "
            f"{a.parameters.components}, and {len(b.modes)} of a {b.surface}, "
            f"{b.parameters.components}.",
            remedy="Fit both with the same number of modes, topology and components.",
        )
    if (a.unit is None) != (b.unit is None):
        raise ParameterError(
            f"One length unit is {a.unit or b.unit}; the other is unknown.",
            remedy="Set the unit of both.",
        )
    scale = 1.0
    if a.unit is not None and b.unit is not None:
        scale = sequence.MM_PER_UNIT[a.unit] / sequence.MM_PER_UNIT[b.unit]
    trajectories = [
        resample_to_phase(amplitudes, N_PHASES, times=signature.times, closed=closed)
        for signature, amplitudes in ((a, a.body_amplitudes * scale), (b, b.body_amplitudes))
    ]
    uses_zero = all(_has_zero(signature) for signature in (a, b))
    if not uses_zero and a.topology is not None and a.topology.closed_axes:
        components, modes = a.parameters.components, a.modes
        trajectories = [theta_invariants(t, modes, components) for t in trajectories]
    by_errors = _by_errors(a, b, scale)
    return Comparison(signature_distance(*trajectories), uses_zero, by_errors)


def _by_errors(a: ModalSignature, b: ModalSignature, scale: float) -> float | None:
    """sqrt(E |e_a - e_b|^2) / |b|, errors of both independent; `scale` brings a to b's unit.

    Turning into the frame of the body keeps the sum over directions, and interpolation between
    phases the mean over them. Magnitudes of pairs differ by no more than the pairs.
    """
    squares = [
        float((s.amplitude_deviations**2).sum(axis=(1, 2)).mean()) * factor**2
        for s, factor in ((a, scale), (b, 1.0))
        if s.amplitude_deviations is not None
    ]
    if not squares:
        return None
    size = float((b.amplitudes**2).sum(axis=(1, 2)).mean())
    if size == 0.0:
        return float("inf") if sum(squares) > 0.0 else 0.0
    return float(np.sqrt(sum(squares) / size))


def _has_zero(signature: ModalSignature) -> bool:
    """Whether amplitudes are comparable as they are: theta starts at a known place."""
    if signature.landmarks is None:
        return signature.topology is None or not signature.topology.closed_axes
    return "theta_zero" not in signature.landmarks.strengths or (
        signature.landmarks.theta_zero_strength >= WEAK
    )
