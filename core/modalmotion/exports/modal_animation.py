"""A signature as an animation of morph targets: modes are targets, amplitudes their weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.reference import reference_positions
from modalmotion.errors import ParameterError
from modalmotion.formats.gltf.morph_animation import MorphAnimation
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import (
    ModalSignature,
    SignatureKind,
    resolve_sequence,
    resolve_template,
)
from modalmotion.template import Template
from modalmotion.template.body_frame import Components
from modalmotion.template.loose_vertices import shapes_of


def modal_animation(
    signature: ModalSignature,
    sequence: MeshSequence,
    max_targets: int | None = None,
    *,
    template: Template | None = None,
) -> MorphAnimation:
    """Convert a signature to targets and weights that play the same as `reconstruct`.

    Each mode and direction is one target, its amplitude the weight; those with most motion come
    first. The mean translation and the rotation move the mesh as a whole.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from: its reference frame gives the shape to deform.
    max_targets : int, optional
        Largest number of targets; `rms_left_out` is the error this causes.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Returns
    -------
    MorphAnimation
        The same positions as `reconstruct`, to rounding, if no target is left out.

    Raises
    ------
    ParameterError
        If the sequence is not the one the signature was made from, or `max_targets` is
        negative.
    """
    if sequence.id != signature.sequence_id:
        raise ParameterError(
            "The signature was made from another sequence.",
            remedy="Give the sequence whose id the signature names.",
        )
    if max_targets is not None and max_targets < 0:
        raise ParameterError(
            f"{max_targets} targets were requested.", remedy="Ask for none or more."
        )
    parameters = signature.parameters
    if parameters.components != Components.CARTESIAN:
        raise ParameterError(
            "The amplitudes are radial, tangential and axial: directions that differ by vertex.",
            remedy="Fit with components = cartesian.",
        )
    if signature.kind == SignatureKind.OFFSET:
        raise ParameterError(
            "Offsets move each vertex along its own normal; a target has one direction.",
            remedy="Fit with kind = material, or write the superposed surfaces.",
        )
    resolved = resolve_sequence(sequence, parameters)
    used = resolve_template(resolved, parameters, template)
    start = reference_positions(sequence, parameters.reference)
    centre = used.weights @ start
    # (2) u = sum_p a_p phi_p, each shape taken about its own mean, which moves the whole.
    phi = shapes_of(signature.modes, used)
    means = used.weights @ phi
    a = signature.amplitudes
    drift = np.einsum("m,fmd->fd", means, a)
    phi = phi - means
    energy = _energies(used.weights, phi, a)
    order = np.argsort(-energy.ravel(), kind="stable")
    moving = order[energy.ravel()[order] > 0]
    taken = moving if max_targets is None else moving[:max_targets]
    modes, directions = np.divmod(taken, 3)
    targets = np.zeros((len(taken), *start.shape), dtype=np.float32)
    targets[np.arange(len(taken)), :, directions] = phi[:, modes].T
    left_out = moving[len(taken) :]
    labels = signature.modes.labels
    return MorphAnimation(
        base=start - centre,
        targets=targets,
        target_names=tuple(
            f"{labels[mode]} {'xyz'[direction]}"
            for mode, direction in zip(modes.tolist(), directions.tolist(), strict=True)
        ),
        weights=a.reshape(len(a), -1)[:, taken],
        rotations=signature.rotations.matrices,
        translations=centre + drift,
        faces=sequence.faces,
        times=signature.times,
        unit=sequence.unit,
        topology=sequence.topology,
        grid=sequence.grid,
        n_left_out=len(left_out),
        rms_left_out=_root_mean_square(phi, a, left_out),
    )


def _energies(
    weights: NDArray[np.float64], phi: NDArray[np.float64], a: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean square displacement of each mode and direction, relative, (modes, 3) float64."""
    # Relative to the largest amplitude: squares of extreme ones overflow or vanish.
    scale = float(np.abs(a).max(initial=0.0)) or 1.0
    energies: NDArray[np.float64] = (weights @ phi**2)[:, None] * ((a / scale) ** 2).mean(axis=0)
    return energies


def _root_mean_square(
    phi: NDArray[np.float64],
    a: NDArray[np.float64],
    indices: NDArray[np.int64],
) -> float:
    if not len(indices):
        return 0.0
    some = np.zeros((a.shape[1] * 3,))
    some[indices] = 1.0
    scale = float(np.abs(a).max(initial=0.0)) or 1.0
    u = np.einsum("vm,fmd->fvd", phi, a / scale * some.reshape(-1, 3))
    return scale * float(np.sqrt((u**2).sum(axis=2).mean()))
