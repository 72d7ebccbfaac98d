"""Which signatures a model can read at all."""

from __future__ import annotations

from typing import Final

from modalmotion.choice.parameters import ModeOrder
from modalmotion.classification.answer.flags import OUT_OF_DOMAIN, UNREADABLE, Flag
from modalmotion.classification.features import has_volume
from modalmotion.classification.model.model import Model
from modalmotion.classification.model.shipped import OFFSET_MODEL
from modalmotion.modes.order import common_count
from modalmotion.modes.topology import CYLINDER
from modalmotion.signature.making import ModalSignature

_OR_STATE: Final = ", or state tracking=material if its points follow the tissue"


def unreadable(signature: ModalSignature, model: Model) -> Flag | None:
    """Flag and reason why the signature cannot be read by the model at all."""
    readable, modes = model.readable, signature.modes
    if signature.n_frames < 2:
        return Flag(UNREADABLE, "one frame shows no motion. Send at least two")
    if signature.kind != readable.parameters.kind:
        return Flag(
            UNREADABLE,
            f"the model reads signatures of the kind {readable.parameters.kind}, and "
            f"this one is of the kind {signature.kind}, which do not compare. Fit it with "
            f"kind={readable.parameters.kind}{_OR_STATE if model.name == OFFSET_MODEL else ''}",
        )
    if signature.surface not in readable.topologies:
        remedy = "State the topology if it is wrong"
        if readable.closes_apices and signature.surface == CYLINDER.name:
            remedy = "Fit it with topology=cup, as a cup of which the apex was cut off"
        return Flag(
            OUT_OF_DOMAIN,
            f"the model reads signatures of the topology "
            f"{' or '.join(readable.topologies)}, this one's is {signature.surface}. {remedy}",
        )
    if modes.connectivity_id != readable.connectivity_id:
        return Flag(
            OUT_OF_DOMAIN,
            "the model reads recordings of one mesh only, and this is another: spring "
            "modes do not compare between meshes. Send it on that mesh, or train a model with a "
            "topology that all surfaces have (topology)",
        )
    if len(modes) != readable.n_modes:
        return Flag(
            UNREADABLE,
            f"the model reads signatures of {readable.n_modes} modes, this one has "
            f"{len(modes)}. Fit it with {readable.n_modes} modes",
        )
    if signature.parameters.order == ModeOrder.FIXED and common_count(modes) < len(modes):
        return Flag(
            UNREADABLE,
            f"the model reads the first {len(modes)} modes of a {signature.surface}, and a lattice "
            f"of too few nodes has only the first {common_count(modes)}. Send a finer one",
        )
    parameters, required = signature.parameters, readable.parameters
    if (parameters.weights, parameters.remove_rotation, parameters.components) != (
        required.weights,
        required.remove_rotation,
        required.components,
    ):
        return Flag(
            UNREADABLE,
            f"the model reads signatures with {required.weights} weights, rotation "
            f"{'removed' if required.remove_rotation else 'kept'} and {required.components} "
            "components. Fit it with the model's signature parameters",
        )
    if model.walls and not _zero_is_known(signature):
        return Flag(
            UNREADABLE,
            "the model tells walls apart, but the zero of theta is not determined by "
            "this shape. State the landmark theta_zero",
        )
    if model.reads_volume and not has_volume(signature):
        return Flag(
            UNREADABLE,
            "the model reads the enclosed volume, which this signature lacks or which turns "
            "inside out. Fit a closed or cup-shaped surface with the model's signature parameters",
        )
    if model.has_axis and not min(signature.lengths) > 0:
        return Flag(
            UNREADABLE,
            "the surface is collapsed in its reference frame. Send it with the model's reference",
        )
    return None


def _zero_is_known(signature: ModalSignature) -> bool:
    return signature.landmarks is not None and "theta_zero" not in signature.landmarks.weak
