"""The error limit, in the length unit of a sequence."""

from __future__ import annotations

import numpy as np

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.noise import Noise
from modalmotion.choice.parameters import ErrorKind, SignatureParameters
from modalmotion.choice.scene import Scene, SceneError, SceneKind
from modalmotion.errors import ParameterError
from modalmotion.fit.fit import Fit
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.numeric.scale import root_mean_square

# Pure noise exceeds its expected mean square by this many standard deviations at most, and
# its estimate is right to this share.
_DEVIATIONS = 3.0
_ESTIMATE = 0.03


def limit_of(parameters: SignatureParameters, sequence: MeshSequence, fit: Fit) -> float:
    """Error that parameters with a tolerance allow.

    Parameters
    ----------
    parameters : SignatureParameters
    sequence : MeshSequence
    fit : Fit
        Of any modes: its motion is read.

    Returns
    -------
    float, length unit of the sequence

    Raises
    ------
    ParameterError
        If the tolerance is in mm and the unit of the sequence is unknown.
    """
    if parameters.tolerance_share is not None:
        is_weighted = parameters.tolerance_of == ErrorKind.WEIGHTED_RMS
        motion = fit.weighted_motion_rms if is_weighted else fit.motion_rms
        return parameters.tolerance_share * root_mean_square(motion)
    require_unit(parameters, sequence)
    return (parameters.tolerance or 0.0) / MM_PER_UNIT[sequence.unit or "mm"]


def require_unit(parameters: SignatureParameters, sequence: MeshSequence) -> None:
    """Refuse a tolerance in mm on numbers that are in an unknown unit.

    Raises
    ------
    ParameterError
    """
    if parameters.tolerance is not None and sequence.unit is None:
        raise ParameterError(
            f"A tolerance of {parameters.tolerance:g} mm was requested, but the length unit of the "
            "sequence is unknown.",
            remedy="State the unit (m, cm, mm, um or nm), or ask by tolerance_share, a share of "
            "the motion.",
        )


def error_of(error: SceneError, kind: ErrorKind) -> float:
    """Error that a tolerance limits."""
    return float(getattr(error, kind.value))


def holds_noise(error: float, noise: Noise, fitter: Fitter, n_directions: int = 3) -> bool:
    """Whether a weighted RMS error is as small as that of noise alone."""
    n_frames, reference = fitter.sequence.n_frames, fitter.parameters.reference
    expected = noise.displacement_rms(n_frames, reference, n_directions)
    # The reference's part of the noise is drawn once for all frames.
    spread = float(np.sqrt(2.0 / (n_directions * noise.independent_vertices)))
    # Not squared: the square of very large coordinates would overflow.
    return error <= expected * float(np.sqrt(1.0 + _ESTIMATE + _DEVIATIONS * spread))


def simplest(scene: Scene, limit: float, kind: ErrorKind) -> SceneKind:
    """Simplest kind of motion that holds a limit."""
    for name, error in scene.errors.items():
        if error_of(error, kind) <= limit:
            return name
    return SceneKind.DEFORMABLE


def simplest_with_noise(scene: Scene, noise: Noise, fitter: Fitter) -> SceneKind:
    """Simplest kind of motion whose residual looks like noise."""
    for name, error in scene.errors.items():
        n_directions = 1 if name == SceneKind.PLANAR else 3
        if holds_noise(error.weighted_rms, noise, fitter, n_directions):
            return name
    return SceneKind.DEFORMABLE
