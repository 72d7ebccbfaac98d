"""The answer of a model for a signature: a class, or the reason for none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.answer.classification import (
    NO_MOTION,
    NOISE,
    OUT_OF_DOMAIN,
    UNREADABLE,
    Classification,
)
from modalmotion.classification.answer.explanation import explain
from modalmotion.classification.covariates import with_covariates
from modalmotion.classification.features import READINGS, Column, MotionFeatures
from modalmotion.classification.model.model import Model
from modalmotion.classification.model.shipped import load_model
from modalmotion.classification.options import require_coverage
from modalmotion.errors import TopologyError
from modalmotion.mesh.sequence import MEAN, MeshSequence
from modalmotion.signature.making import ModalSignature, modal_signature, provenance

_REFERENCE_NOTE = (
    "The signature is measured from one frame, so the answer depends on which it is; fitted with "
    "the model's signature parameters, which name the mean shape, it does not."
)
_MIRRORED_NOTE = (
    "The columns run left-handed about the axis from the apex; the motion was read accordingly."
)


def classify(
    motion: ModalSignature | MeshSequence,
    model: Model | None = None,
    coverage: float = 0.9,
    covariates: Mapping[str, float | str] | None = None,
) -> Classification:
    """Name the class of a motion, or abstain.

    Parameters
    ----------
    motion : ModalSignature or MeshSequence
        A signature is best fitted with `model.signature_parameters`, as a sequence is here: another
        reference adds a note to the answer. Other differences are refused.
    model : Model, optional
        The shipped one by default.
    coverage : float
        Probability with which the class set is to hold the true class.
    covariates : mapping of str to (float or str), optional
        Such as an age: over those of the recording's facts.

    Returns
    -------
    Classification
        Without a label, with equal probabilities and all classes in the set, where the model
        cannot tell; flags and the first note say why. "No motion" is such an answer and no
        class: it is a measurement against a limit, and amplitudes that are noise should not be
        called a kind of motion.

    Raises
    ------
    ParameterError
        If the coverage is not above 0 and below 1, or a covariate is neither a finite number
        nor a short word.
    """
    require_coverage(coverage)
    if model is None:
        model = load_model()
    signature = with_covariates(motion, covariates) if covariates else motion
    if isinstance(signature, MeshSequence):
        signature = fitted_for(model, signature)
    refusal = _unreadable(signature, model)
    reading = None if refusal is not None else _read(signature, model)
    if reading is not None:
        refusal = reading.refusal
    if reading is None or refusal is not None:
        flag, why = refusal or (UNREADABLE, "")
        return _abstention(signature, model, coverage, flag, why)
    logs = model.log_shares(reading.values[None])
    probabilities = np.exp(logs[0] - logs.max())
    probabilities /= probabilities.sum()
    label = model.classes[int(probabilities.argmax())]
    notes = [*model.notes.get(label, ()), *model.notes.get("", ())]
    if model.signature_parameters.reference == MEAN != signature.parameters.reference:
        notes.append(_REFERENCE_NOTE)
    if reading.is_mirrored:
        notes.insert(0, _MIRRORED_NOTE)
    few = model.calibration.too_few(coverage)
    if few:
        names = ", ".join(model.classes[k] for k in few)
        notes.append(
            f"Too few cases to rule out {names} at a coverage of {coverage:.3g}: every class set "
            f"holds {'it' if len(few) == 1 else 'them'}."
        )
    held = model.calibration.holds(probabilities[None], coverage)[0]
    return Classification(
        sequence_id=signature.sequence_id,
        model=model.name,
        model_id=model.id,
        label=label,
        classes=model.classes,
        probabilities=probabilities,
        class_set=tuple(c for c, keep in zip(model.classes, held, strict=True) if keep),
        coverage=coverage,
        flags=(),
        explanation=explain(signature, model, reading.values, reading.columns, probabilities),
        notes=tuple(notes),
        provenance=provenance(),
    )


def fitted_for(model: Model, sequence: MeshSequence) -> ModalSignature:
    """Fit a sequence for a model: in the model's topology, if its surface allows that.

    One recording of a mesh may look like another topology than the rest, as where an axis
    bends; the model's is then imposed, unless the sequence states its own.
    """
    parameters = model.signature_parameters
    signature = modal_signature(sequence, parameters)
    imposed = model.readable.imposed_on(signature.surface, sequence.topology)
    if imposed is None:
        return signature
    try:
        return modal_signature(sequence, imposed)
    except TopologyError:
        return signature


@dataclass(frozen=True, eq=False)
class _Reading:
    values: NDArray[np.float64]
    columns: tuple[Column, ...]
    is_mirrored: bool
    refusal: tuple[str, str] | None


def _abstention(
    signature: ModalSignature, model: Model, coverage: float, flag: str, why: str
) -> Classification:
    n = len(model.classes)
    return Classification(
        sequence_id=signature.sequence_id,
        model=model.name,
        model_id=model.id,
        label=None,
        classes=model.classes,
        probabilities=np.full(n, 1.0 / n),
        class_set=model.classes,
        coverage=coverage,
        flags=(flag,),
        explanation=(),
        notes=(why, *model.notes.get("", ())),
        provenance=provenance(),
    )


def _unreadable(signature: ModalSignature, model: Model) -> tuple[str, str] | None:
    """Flag and reason why the signature cannot be read by the model at all."""
    readable, modes = model.readable, signature.modes
    if signature.n_frames < 2:
        return UNREADABLE, "No class: one frame shows no motion."
    if signature.surface not in readable.topologies:
        return OUT_OF_DOMAIN, (
            f"No class: the model reads signatures of the topology "
            f"{' or '.join(readable.topologies)}, this one's is {signature.surface}. State the "
            "topology if it is wrong."
        )
    if modes.connectivity_id != readable.connectivity_id:
        return OUT_OF_DOMAIN, (
            "No class: the model reads recordings of one mesh only, and this is another: spring "
            "modes do not compare between meshes."
        )
    if len(modes) != readable.n_modes:
        return UNREADABLE, (
            f"No class: the model reads signatures of {readable.n_modes} modes, this one has "
            f"{len(modes)}. Fit it with {readable.n_modes} modes."
        )
    parameters, required = signature.parameters, readable.parameters
    if (parameters.weights, parameters.remove_rotation, parameters.components) != (
        required.weights,
        required.remove_rotation,
        required.components,
    ):
        return UNREADABLE, (
            f"No class: the model reads signatures with {required.weights} weights, rotation "
            f"{'removed' if required.remove_rotation else 'kept'} and {required.components} "
            "components. Fit it with the model's signature parameters."
        )
    if model.reader.walls and not _zero_is_known(signature):
        return UNREADABLE, (
            "No class: the model tells walls apart, but the zero of theta is not determined by "
            "this shape. State the landmark theta_zero."
        )
    if model.reader.has_axis and not min(signature.lengths) > 0:
        return UNREADABLE, "No class: the surface is collapsed in its reference frame."
    return None


def _zero_is_known(signature: ModalSignature) -> bool:
    return signature.landmarks is not None and "theta_zero" not in signature.landmarks.weak


def _read(signature: ModalSignature, model: Model) -> _Reading:
    """Features in the reading that is nearest to what the model knows."""
    seen = model.domain.reader.read(signature)
    distances = model.distance(seen.kinds)
    nearest = int(distances.argmin())
    features = model.reader.read(signature)
    return _Reading(
        values=features.values[nearest if len(features.values) > 1 else 0],
        columns=features.columns,
        is_mirrored=len(seen.values) > 1 and READINGS[nearest].is_mirrored,
        refusal=_refusal(seen, float(distances[nearest]), model),
    )


def _refusal(features: MotionFeatures, distance: float, model: Model) -> tuple[str, str] | None:
    domain = model.domain
    if features.motion < domain.least_motion or features.motion == 0.0:
        return NO_MOTION, (
            f"No class, no motion: it deforms by {features.motion:.2%} of its size, less than "
            f"{domain.least_motion:.2%}."
        )
    if features.smooth_share < domain.least_smooth:
        return NOISE, (
            "No class: the motion is mostly noise from frame to frame (a smooth one would hold "
            f"1, this one {features.smooth_share:.2f})."
        )
    if distance > domain.limit:
        return OUT_OF_DOMAIN, (
            f"No class: the motion is unlike any that the model was trained on (distance "
            f"{distance:.2f} from the nearest class, limit {domain.limit:.2f})."
        )
    return None
