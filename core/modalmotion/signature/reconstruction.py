"""Surfaces superposed from a signature: (2) of Nastar (1994), rotation put back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.fit.superposition import Superposition
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import (
    ModalSignature,
    SignatureKind,
    resolve_sequence,
    resolve_template,
)
from modalmotion.template import Template
from modalmotion.template.vibration_modes import shapes_of


def reconstruct(
    signature: ModalSignature,
    sequence: MeshSequence,
    frames: NDArray[np.int64] | list[int] | None = None,
    *,
    template: Template | None = None,
) -> NDArray[np.float64]:
    """Positions that the signature's modes and rotations stand for.

    Offsets move the reference along its normals: the vertices are then points of the surface, and
    not those of the sequence.

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
    parameters = signature.parameters
    used = fitted_on(signature, sequence, template)
    shapes, reference = shapes_of(signature.modes, used), parameters.reference
    if parameters.kind == SignatureKind.OFFSET:
        on = Superposition.of_offsets(sequence, used, shapes, reference=reference)
    else:
        components = parameters.components
        on = Superposition.on(sequence, used, shapes, reference=reference, components=components)
    rows = slice(None) if frames is None else np.asarray(frames)
    return on.positions(
        signature.amplitudes[rows],
        signature.rotations.matrices[rows],
        signature.translations[rows],
    )


def fitted_on(
    signature: ModalSignature, sequence: MeshSequence, template: Template | None = None
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
    resolved = resolve_sequence(sequence, signature.parameters)
    return resolve_template(resolved, signature.parameters, template)
