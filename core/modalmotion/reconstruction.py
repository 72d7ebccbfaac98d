"""Surfaces superposed from a signature: eq. 2 of Nastar 1994, rotation put back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.basis import Basis, make_basis
from modalmotion.body_frame import Components, from_local, local_frames
from modalmotion.errors import ParameterError
from modalmotion.sequence import MeshSequence
from modalmotion.signature import ModalSignature, resolve_sequence, resolve_template
from modalmotion.template import Template, choose_modes


def reconstruct(
    signature: ModalSignature,
    sequence: MeshSequence,
    frames: NDArray[np.int64] | list[int] | None = None,
    *,
    template: Template | None = None,
) -> NDArray[np.float64]:
    """Positions that the signature's modes and rotations stand for.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from: its reference frame gives the shape to deform.
    frames : (n,) int, optional
        Which frames; all of them by default.
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
    used, basis = fitted_on(signature, sequence, template)
    asked = signature.parameters
    start = sequence.vertices[asked.reference].astype(np.float64)
    centre = used.weights @ start
    chosen = slice(None) if frames is None else np.asarray(frames)
    # (2) u = sum_p a_p phi_p
    u = basis.shapes @ signature.amplitudes[chosen]
    if asked.components != Components.CARTESIAN:
        u = from_local(u, local_frames(used))
    drift = signature.translations[chosen][:, None, :]
    R = signature.rotations.matrices[chosen]
    positions: NDArray[np.float64] = (start - centre + u - drift) @ R.transpose(0, 2, 1)
    positions += centre + drift
    return positions


def fitted_on(
    signature: ModalSignature, sequence: MeshSequence, template: Template | None = None
) -> tuple[Template, Basis]:
    """Give the template and the modes that a signature's amplitudes belong to.

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
    resolved = resolve_sequence(sequence, signature.parameters)
    used = resolve_template(resolved, signature.parameters, template)
    modes = choose_modes(used, len(signature.modes), resolved.grid).modes
    return used, make_basis(used, modes)
