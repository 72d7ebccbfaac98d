"""Surfaces superposed from a signature: eq. 2 of Nastar 1994, rotation put back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.modes import shapes_at
from modalmotion.sequence import MeshSequence
from modalmotion.signature import ModalSignature, resolve_sequence
from modalmotion.template import make_template


def reconstruct(
    signature: ModalSignature,
    sequence: MeshSequence,
    frames: NDArray[np.int64] | list[int] | None = None,
) -> NDArray[np.float64]:
    """Positions that the signature's modes and rotations stand for.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from: its reference frame gives the shape to deform.
    frames : (n,) int, optional
        Which frames; all of them by default.

    Returns
    -------
    (n, vertices, 3) float64, unit of the sequence

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
    asked = signature.parameters
    template = make_template(
        resolve_sequence(sequence, asked), reference=asked.reference, weights=asked.weights
    )
    start = sequence.vertices[asked.reference].astype(np.float64)
    centre = template.weights @ start
    chosen = slice(None) if frames is None else np.asarray(frames)
    # (2) u = sum_p a_p phi_p
    u = shapes_at(signature.modes, template.coordinates) @ signature.amplitudes[chosen]
    # The fit holds the centroid's path exactly, for the constant mode is among its modes.
    drift = np.matmul(template.weights, u)[:, None, :]
    R = signature.rotations.matrices[chosen]
    positions: NDArray[np.float64] = (start - centre + u - drift) @ R.transpose(0, 2, 1)
    positions += centre + drift
    return positions
