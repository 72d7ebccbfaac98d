"""Distance between two signatures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.representation import shown
from modalmotion.signature.distance import resample_to_phase, signature_distance, theta_invariants
from modalmotion.signature.making import ModalSignature
from modalmotion.template.landmarks import WEAK

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
        its mean square: a distance no larger than it shows no difference. None where neither has
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
            "points and offsets of a surface do not compare.",
            remedy="Fit both with kind=offset, which every surface has, or both with "
            "kind=material, if the points of both follow the tissue.",
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
            f"One length unit is {a.unit or b.unit}, the other is unknown.",
            remedy="State the unit of both.",
        )
    scale = 1.0
    if a.unit is not None and b.unit is not None:
        scale = MM_PER_UNIT[a.unit] / MM_PER_UNIT[b.unit]
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
