"""A signature at times between its frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.mesh.alignment import Rotations
from modalmotion.signature.making import ModalSignature


def at_times(signature: ModalSignature, times: NDArray[np.float64]) -> ModalSignature:
    """Trajectory of a signature at other times.

    Amplitudes follow cubic splines, rotations the shortest turn between frames. Errors and
    deviations are those of the frames nearest in time: what lies between frames was not measured.

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
        If `times` is empty, or one lies outside the recording.
    """
    own = _times_of(signature)
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
    if len(own) == 1:
        amplitudes, translations = signature.amplitudes[nearest], signature.translations[nearest]
        matrices = signature.rotations.matrices[nearest]
    else:
        amplitudes = scipy.interpolate.CubicSpline(own, signature.amplitudes, axis=0)(instants)
        translations = scipy.interpolate.CubicSpline(own, signature.translations, axis=0)(instants)
        turns = scipy.spatial.transform.Rotation.from_matrix(signature.rotations.matrices)
        matrices = scipy.spatial.transform.Slerp(own, turns)(instants).as_matrix()
    # At a frame the trajectory is the frame's own, to the last bit.
    exact = own[nearest] == instants
    amplitudes[exact] = signature.amplitudes[nearest[exact]]
    translations[exact] = signature.translations[nearest[exact]]
    matrices[exact] = signature.rotations.matrices[nearest[exact]]
    deviations = signature.amplitude_deviations
    return replace(
        signature,
        amplitudes=amplitudes,
        translations=translations,
        rotations=Rotations(matrices, signature.rotations.is_determined[nearest]),
        rms_errors=signature.rms_errors[nearest],
        weighted_rms_errors=signature.weighted_rms_errors[nearest],
        p95_errors=signature.p95_errors[nearest],
        max_errors=signature.max_errors[nearest],
        motion_rms=signature.motion_rms[nearest],
        weighted_motion_rms=signature.weighted_motion_rms[nearest],
        times=instants,
        amplitude_deviations=None if deviations is None else deviations[nearest],
    )


def _times_of(signature: ModalSignature) -> NDArray[np.float64]:
    if signature.times is not None:
        return signature.times
    return np.arange(signature.n_frames, dtype=np.float64)
