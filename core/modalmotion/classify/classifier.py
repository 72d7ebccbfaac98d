"""What a model says of a signature: a class, or why it gives none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.classify.classification import OUT_OF_DOMAIN, Classification
from modalmotion.classify.model import Model, load_model
from modalmotion.features import READINGS, motion_features
from modalmotion.modes import lowest_modes
from modalmotion.signature import ModalSignature, provenance

_MIRRORED_NOTE = (
    "The columns run left-handed about the axis from the apex; the motion was read accordingly."
)


def classify(
    signature: ModalSignature, model: Model | None = None, coverage: float = 0.9
) -> Classification:
    """Name the class of a motion, or abstain.

    Parameters
    ----------
    signature : ModalSignature
        Fitted with `model.signature_parameters`; any reference frame will do.
    model : Model, optional
        The shipped one by default.

    Returns
    -------
    Classification
        Without a label, and with equal probabilities, where the model cannot tell; the first
        notes say why. "No motion" is such an answer and no class: it is a measurement against
        a limit, and amplitudes that are noise should not be given a kind of motion.
    """
    chosen = load_model() if model is None else model
    refusal = _refusal(signature, chosen)
    read: _Read | None = None
    if refusal is None:
        read = _read(signature, chosen)
        refusal = read.refusal
    notes: tuple[str, ...] = chosen.notes.get("", ())
    label: str | None = None
    if read is None or refusal is not None:
        probabilities = np.full(len(chosen.classes), 1.0 / len(chosen.classes))
        notes = (refusal or "", *notes)
    else:
        probabilities = chosen.probabilities(read.values)
        label = chosen.classes[int(probabilities.argmax())]
        notes = (*chosen.notes.get(label, ()), *notes)
        if read.is_mirrored:
            notes = (_MIRRORED_NOTE, *notes)
    return Classification(
        sequence_id=signature.sequence_id,
        model=chosen.name,
        model_id=chosen.id,
        label=label,
        classes=chosen.classes,
        probabilities=probabilities,
        class_set=chosen.classes if label is None else (label,),
        coverage=coverage,
        flags=() if label is not None else (OUT_OF_DOMAIN,),
        explanation=(),
        notes=notes,
        provenance=provenance(),
    )


@dataclass(frozen=True, eq=False)
class _Read:
    values: NDArray[np.float64]
    is_mirrored: bool
    refusal: str | None


def _refusal(signature: ModalSignature, model: Model) -> str | None:
    """Why the signature cannot be read by the model at all."""
    needed = model.signature_parameters
    if signature.n_frames < 2:
        return "No class: one frame shows no motion."
    if signature.topology is None or signature.surface not in model.topologies:
        return (
            f"No class: the model reads signatures of the topology "
            f"{' or '.join(model.topologies)}, this one's is {signature.surface}. State the "
            "topology if it is wrong."
        )
    if signature.modes != lowest_modes(signature.topology, model.modes):
        return (
            f"No class: the model reads signatures of {model.modes} modes, this one has "
            f"{len(signature.modes)}. Fit it with {model.modes} modes."
        )
    asked = signature.parameters
    if (asked.weights, asked.remove_rotation, asked.components) != (
        needed.weights,
        needed.remove_rotation,
        needed.components,
    ):
        return (
            "No class: the model reads signatures with area weights, rotation removed and "
            "Cartesian components. Fit it with the default parameters."
        )
    if not min(signature.lengths) > 0:
        return "No class: the surface is collapsed in its reference frame."
    return None


def _read(signature: ModalSignature, model: Model) -> _Read:
    """Features in the reading that is nearest to what the model knows."""
    readings = [motion_features(signature, reading) for reading in READINGS]
    distances = model.distance(np.stack([features.values for features in readings]))
    nearest = int(distances.argmin())
    found, distance = readings[nearest], float(distances[nearest])
    refusal: str | None = None
    if found.motion < model.least_motion:
        refusal = (
            f"No class, no motion: it deforms by {found.motion:.2%} of its size, less than "
            f"{model.least_motion:.2%}."
        )
    elif found.periodic_share < model.least_periodic_share:
        refusal = (
            "No class: the motion is mostly noise from frame to frame (a smooth beat would hold "
            f"1, this one {found.periodic_share:.2f})."
        )
    elif distance > model.farthest:
        refusal = (
            f"No class: the motion is unlike any that the model was trained on (distance "
            f"{distance:.1f} from the nearest class, limit {model.farthest:.1f})."
        )
    return _Read(found.values, READINGS[nearest].is_mirrored, refusal)
