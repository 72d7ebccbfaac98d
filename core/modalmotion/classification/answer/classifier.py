"""The answer of a model for a signature: a class, or the reason for none."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from modalmotion.classification.answer.class_set import class_set, few_cases
from modalmotion.classification.answer.classification import Classification
from modalmotion.classification.answer.explanation import explain
from modalmotion.classification.answer.flags import OUT_OF_DOMAIN, Flag
from modalmotion.classification.answer.hands import read_hands
from modalmotion.classification.answer.readability import unreadable
from modalmotion.classification.covariates import covariate_notes, with_covariates
from modalmotion.classification.model.model import Model, Readable
from modalmotion.classification.model.shipped import (
    DEFAULT_MODEL,
    OFFSET_MODEL,
    load_model,
    shipped_for,
)
from modalmotion.classification.options import require_coverage
from modalmotion.errors import ModeCountError, TopologyError
from modalmotion.facts import UNKNOWN
from modalmotion.mesh.sequence import MEAN, MeshSequence
from modalmotion.signature.making import ModalSignature, modal_signature, provenance

_REFERENCE_NOTE = (
    "The signature is measured from one frame, so the answer depends on which it is; fitted with "
    "the model's signature parameters, which name the mean shape, it does not."
)
_TRACKING_NOTE = (
    "What the points follow is not stated, so only the surface was read, which shows no twist. "
    "If they follow the tissue (tagging, feature tracking), state tracking=material."
)

_UNEXPLAINED_NOTE = "So no mode of the surface explains the answer."


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
        By default the shipped one that reads what the points follow: displacements where the facts
        say tracking=material, offsets otherwise.
    coverage : float
        Probability with which the class set is to hold the true class.
    covariates : mapping of str to (float or str), optional
        Such as an age: over those of the recording's facts. Notes name those that the model does
        not know, and those that it reads and nobody states.

    Returns
    -------
    Classification
        Without a label, with equal probabilities and all classes in the set, where the model
        cannot tell; flags and the first notes say why, and what to do. "No motion" is such an
        answer and no class: it is a measurement against a limit, and amplitudes that are noise
        should not be called a kind of motion.

    Raises
    ------
    ParameterError
        If the coverage is not above 0 and below 1, or a covariate is neither a finite number
        nor a short word.
    """
    require_coverage(coverage)
    if model is None:
        model = load_model(shipped_for(DEFAULT_MODEL, motion.facts))
    signature = with_covariates(motion, covariates) if covariates else motion
    if isinstance(signature, MeshSequence):
        signature = fitted_for(model, signature)
    refusal = unreadable(signature, model)
    if refusal is not None:
        return _abstention(signature, model, coverage, (refusal,))
    read = read_hands(signature, model)
    flags = read.better.flags(model.domain)
    if flags:
        return _abstention(signature, model, coverage, flags)
    probabilities = read.probabilities
    label = model.label(probabilities)
    apart = read.better.judgement.of_classes[0]
    held = class_set(model, probabilities, label, coverage, apart)
    if held.is_strange:
        return _abstention(signature, model, coverage, (Flag(OUT_OF_DOMAIN, held.words),))
    notes = [*read.notes(model.classes), held.words]
    notes += [*model.notes.get(label, ()), *model.notes.get("", ())]
    if model.decision is not None:
        notes.append(model.decision.text)
    if model.signature_parameters.reference == MEAN != signature.parameters.reference:
        notes.append(_REFERENCE_NOTE)
    if model.name == OFFSET_MODEL and signature.facts.tracking == UNKNOWN:
        notes.insert(0, _TRACKING_NOTE)
    explanation = explain(read.better, model, probabilities)
    notes.append(model.no_motion_note)
    if model.no_motion_note and not explanation:
        notes.append(_UNEXPLAINED_NOTE)
    notes.append(few_cases(model, coverage))
    notes += _covariate_notes(signature, model)
    return Classification(
        sequence_id=signature.sequence_id,
        model=model.name,
        model_id=model.id,
        label=label,
        classes=model.classes,
        probabilities=probabilities,
        class_set=held.classes,
        coverage=coverage,
        flags=(),
        explanation=explanation,
        notes=tuple(filter(None, notes)),
        provenance=provenance(),
    )


def fitted_for(model: Model, sequence: MeshSequence) -> ModalSignature:
    """Fit a sequence for a model: see `fitted_in`."""
    return fitted_in(model.readable, sequence)


def fitted_in(readable: Readable, sequence: MeshSequence) -> ModalSignature:
    """Fit a sequence in modes that are readable: in their topology, if its surface allows that.

    One recording of a mesh may look like another topology than the rest, as where an axis
    bends; the readable one is then imposed, unless the sequence states its own.
    """
    try:
        signature = modal_signature(sequence, readable.parameters)
    except ModeCountError as error:
        raise ModeCountError(
            f"The model reads {readable.n_modes} modes, and this recording's vertices do not tell "
            f"as many apart. {error.message}",
            remedy="Send a finer mesh, or train a model on recordings like this one: it reads as "
            "many modes as they have.",
            details=error.details,
        ) from error
    imposed = readable.imposed_on(signature.surface, sequence.topology)
    if imposed is None:
        return signature
    try:
        return modal_signature(sequence, imposed)
    except TopologyError:
        return signature


def _abstention(
    signature: ModalSignature, model: Model, coverage: float, flags: tuple[Flag, ...]
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
        flags=tuple(flag.name for flag in flags),
        explanation=(),
        notes=tuple(
            filter(
                None,
                (
                    *(f"No class: {flag.words}." for flag in flags),
                    *model.notes.get("", ()),
                    model.no_motion_note,
                    *_covariate_notes(signature, model),
                ),
            )
        ),
        provenance=provenance(),
    )


def _covariate_notes(signature: ModalSignature, model: Model) -> tuple[str, ...]:
    read = (one.name for member in model.members for one in member.reader.covariates)
    return covariate_notes(read, signature.facts.covariates)
