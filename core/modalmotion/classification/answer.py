"""The answer of a model for a motion: a class, or the reason for none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.checking import Plotted, Saved
from modalmotion.classification.explanation import ModeContribution, explain
from modalmotion.classification.extractor import volume_share
from modalmotion.classification.model import Model, Readable
from modalmotion.classification.model_files import (
    DEFAULT_MODEL,
    OFFSET_MODEL,
    load_model,
    shipped_for,
)
from modalmotion.classification.motion import Motion
from modalmotion.classification.options import require_coverage
from modalmotion.classification.outliers import OUT_OF_DOMAIN, UNREADABLE, Flag
from modalmotion.errors import ModeCountError, TopologyError
from modalmotion.mesh import UNKNOWN
from modalmotion.mesh.sequence import MEAN, MeshSequence
from modalmotion.modes.order import common_count
from modalmotion.modes.topology import CYLINDER
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature, modal_signature, provenance
from modalmotion.signature.value import first_modes

# Level at which a case that is in no set is like no class.
_STRICT: Final = 0.995

# Of the amplitudes: above it probabilities were too sure (docs/decisions/0039).
_UNSURE: Final = 0.2

_REFERENCE_NOTE: Final = (
    "The signature is measured from one frame, so the answer depends on which it is; fitted with "
    "the model's signature parameters, which name the mean shape, it does not."
)
_TRACKING_NOTE: Final = (
    "What the points follow is not stated, so only the surface was read, which shows no twist. "
    "If they follow the tissue (tagging, feature tracking), state tracking=material."
)

Array = NDArray[np.float64]


@shown("label", "probability", "class_set", "coverage", "flags", "model")
@dataclass(frozen=True, eq=False)
class Classification(Saved, Plotted):
    """A motion class with its probability, or none where the model cannot tell.

    Parameters
    ----------
    sequence_id : str
    model : str
        Name of the model.
    model_id : str
        sha256 of the model's arrays, in hex.
    label : str or None
        The most probable class; None where the model abstains (see `notes`).
    classes : tuple of str
    probabilities : (classes,) float64
        They add up to 1.
    class_set : tuple of str
        Classes that cannot be ruled out: of cases like the training ones it holds the true
        class with the probability `coverage`, whatever the class is. Empty where the case is
        like none at this level: a note says so.
    coverage : float
        The requested level.
    flags : tuple of str
        Of `FLAGS`; empty where nothing speaks against the answer.
    explanation : tuple of ModeContribution
        Modes that moved the prediction, the strongest first; may be empty.
    notes : tuple of str
        Why it abstains, and what a user should know of the model.
    provenance : dict
        Versions of the software that made it.
    """

    sequence_id: str
    model: str
    model_id: str
    label: str | None
    classes: tuple[str, ...]
    probabilities: Array
    class_set: tuple[str, ...]
    coverage: float
    flags: tuple[str, ...]
    explanation: tuple[ModeContribution, ...]
    notes: tuple[str, ...]
    provenance: dict[str, str]

    @property
    def probability(self) -> float:
        """Probability of the label; where there is none, of the most probable class."""
        if self.label is None:
            return float(self.probabilities.max())
        return float(self.probabilities[self.classes.index(self.label)])


def classify(
    motion: ModalSignature | MeshSequence,
    model: Model | None = None,
    coverage: float = 0.9,
) -> Classification:
    """Name the class of a motion, or abstain.

    Parameters
    ----------
    motion : ModalSignature or MeshSequence
        A signature is best fitted with `model.signature_parameters`, as a sequence is here: another
        reference adds a note to the answer. Other differences are refused.
    model : Model, optional
        By default the shipped one that reads what the points follow: displacements where the facts
        say tracking=material, normal displacements otherwise.
    coverage : float
        Probability with which the class set is to hold the true class.

    Returns
    -------
    Classification
        Without a label, with equal probabilities and all classes in the set, where the model
        cannot tell; flags and the first notes say why, and what to do. "No motion" is such an
        answer and no class: it is a measurement against a limit, and amplitudes that are noise
        should not be called a kind of motion. A class that the share of the volume rules out, by
        those of its training cases, is not named.

    Raises
    ------
    ParameterError
        If the coverage is not above 0 and below 1.
    """
    require_coverage(coverage)
    if model is None:
        model = load_model(shipped_for(DEFAULT_MODEL, motion.facts))
    signature = motion
    if isinstance(signature, MeshSequence):
        signature = fitted_in(model.readable, signature)
    refusal = _unreadable(signature, model)
    if refusal is not None:
        return _answer(signature, model, coverage, (refusal,))
    read = Motion(first_modes(signature, model.readable.n_modes))
    if model.reads_volume and read.volumes is None:
        return _answer(signature, model, coverage, (_NO_VOLUME,))
    flags = model.outliers.flags(read)
    if flags:
        return _answer(signature, model, coverage, flags)
    features = model.features(read)
    probabilities = model.probabilities(features[None])[0]
    share = volume_share(read)
    ruled_out = model.contradicts(share)
    if ruled_out.all():
        words = (
            f"it loses {share:.0%} of its volume, which no class of the model does. Look at the "
            "recording"
        )
        return _answer(signature, model, coverage, (Flag(OUT_OF_DOMAIN, words),))
    likeliest = int(probabilities.argmax())
    notes = []
    if ruled_out[likeliest]:
        low, high = model.shares[likeliest]
        notes.append(
            f"It moves most like {model.classes[likeliest]}, but loses {share:.0%} of its volume, "
            f"and training cases of that class {low:.0%} to {high:.0%}: that class is ruled out."
        )
    probabilities = np.where(ruled_out, 0.0, probabilities)
    probabilities = probabilities / probabilities.sum()
    found = _class_set(model, probabilities, coverage)
    if found.is_strange:
        return _answer(signature, model, coverage, (Flag(OUT_OF_DOMAIN, found.words),))
    label = model.classes[int(probabilities.argmax())]
    notes += [found.words, *model.notes.get(label, ())]
    return Classification(
        sequence_id=signature.sequence_id,
        model=model.name,
        model_id=model.id,
        label=label,
        classes=model.classes,
        probabilities=probabilities,
        class_set=found.classes,
        coverage=coverage,
        flags=(),
        explanation=explain(features, model, read, probabilities),
        notes=(
            *_notes(signature, model),
            *filter(None, notes),
            *model.notes.get("", ()),
            *_few_cases(model, coverage),
        ),
        provenance=provenance(),
    )


def fitted_in(readable: Readable, sequence: MeshSequence) -> ModalSignature:
    """Fit a sequence in modes that are readable: in their topology, if its surface allows that.

    One recording of a mesh may look like another topology than the rest, as where an axis
    bends; the readable one is then imposed, unless the sequence states its own. What is none of
    the topology that the parameters state is fitted as it is, for the answer to say so.
    """
    try:
        try:
            signature = modal_signature(sequence, readable.parameters)
            imposed = readable.imposed_on(signature.surface, sequence.topology)
        except TopologyError:
            signature = modal_signature(sequence, replace(readable.parameters, topology=None))
            imposed = readable.imposed_on(signature.surface, sequence.topology)
    except ModeCountError as error:
        raise ModeCountError(
            f"The model reads {readable.n_modes} modes, and this recording's vertices do not tell "
            f"as many apart. {error.message}",
            remedy="Send a finer mesh, or train a model on recordings like this one: it reads as "
            "many modes as they have.",
            details=error.details,
        ) from error
    if imposed is None:
        return signature
    try:
        return modal_signature(sequence, imposed)
    except TopologyError:
        return signature


def unlike(signature: ModalSignature, readable: Readable) -> Flag | None:
    """Say why a signature is not in modes that are readable; None where it is."""
    parameters, required, modes = signature.parameters, readable.parameters, signature.modes
    kind, n = required.kind, readable.n_modes
    if signature.n_frames < 2:
        return Flag(UNREADABLE, "one frame shows no motion. Send at least two")
    if signature.kind != kind:
        return Flag(
            UNREADABLE,
            f"the model reads signatures of the kind {kind}, and this one is of the kind "
            f"{signature.kind}, which do not compare. Fit it with kind={kind}",
        )
    if signature.surface != readable.topology:
        remedy = "State the topology if it is wrong"
        if readable.closes_apices and signature.surface == CYLINDER.name:
            remedy = "Fit it with topology=cup, as a cup of which the apex was cut off"
        return Flag(
            OUT_OF_DOMAIN,
            f"the model reads signatures of the topology {readable.topology}, this one's is "
            f"{signature.surface}. {remedy}",
        )
    if modes.connectivity_id != readable.connectivity_id:
        return Flag(
            OUT_OF_DOMAIN,
            "the model reads recordings of one mesh only, and this is another: spring "
            "modes do not compare between meshes. Send it on that mesh, or train a model with a "
            "topology that all surfaces have (topology)",
        )
    if len(modes) < n or common_count(modes) < n:
        return Flag(
            UNREADABLE,
            f"the model reads the first {n} modes of a {signature.surface}, and this signature "
            f"has {common_count(modes)}. Fit it with {n} "
            "modes, and send a finer mesh if it is too coarse",
        )
    if (parameters.remove_rotation, parameters.components) != (
        required.remove_rotation,
        required.components,
    ):
        return Flag(
            UNREADABLE,
            f"the model reads signatures with the rotation "
            f"{'removed' if required.remove_rotation else 'kept'} and {required.components} "
            "components. Fit it with the model's signature parameters",
        )
    return None


_NO_VOLUME: Final = Flag(
    UNREADABLE,
    "the model reads the volume of a cavity, which this signature lacks or which turns inside "
    "out. Fit a cup-shaped surface, or state its cavity, with the model's signature parameters",
)


def _unreadable(signature: ModalSignature, model: Model) -> Flag | None:
    """Flag and reason why the signature cannot be read by the model at all."""
    reason = unlike(signature, model.readable)
    if reason is not None:
        if model.name == OFFSET_MODEL and signature.kind != model.signature_parameters.kind:
            text = ", or state tracking=material if its points follow the tissue"
            reason = reason._replace(words=reason.words + text)
        return reason
    landmarks = signature.landmarks
    if model.walls and (landmarks is None or "theta_zero" in landmarks.weak):
        return Flag(
            UNREADABLE,
            "the model tells walls apart, but the zero of theta is not determined by "
            "this shape. State the landmark theta_zero",
        )
    if not Motion(signature).size > 0.0:
        return Flag(
            UNREADABLE,
            "the surface is collapsed in its reference frame. Send it with the model's reference",
        )
    return None


def _notes(signature: ModalSignature, model: Model) -> list[str]:
    """Say of the recording what a user needs."""
    notes = []
    if model.name == OFFSET_MODEL and signature.facts.tracking == UNKNOWN:
        notes.append(_TRACKING_NOTE)
    share = signature.deviation_share
    if share:
        text = f"The standard deviations of its amplitudes are {share:.0%} of them"
        if share >= _UNSURE:
            text += ", which the probabilities do not contain: they are too sure"
        notes.append(f"{text}.")
    if model.signature_parameters.reference == MEAN != signature.parameters.reference:
        notes.append(_REFERENCE_NOTE)
    return notes


def _answer(
    signature: ModalSignature, model: Model, coverage: float, flags: tuple[Flag, ...]
) -> Classification:
    """Abstain, for what the flags say."""
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
        notes=(*(f"No class: {flag.words}." for flag in flags), *model.notes.get("", ())),
        provenance=provenance(),
    )


class _ClassSet(NamedTuple):
    """Classes that cannot be ruled out; why there is none; whether the case is like no class."""

    classes: tuple[str, ...]
    words: str
    is_strange: bool


def _class_set(model: Model, probabilities: Array, coverage: float) -> _ClassSet:
    """Find the classes that cannot be ruled out, those without any probability left out.

    The label is in the set wherever another class is. A set may be empty: of cases like the
    training ones up to 1 - coverage have no class in it. Such a case keeps its label, unless its
    set is empty at a level of 99.5 %, too.
    """
    possible = probabilities > 0.0
    likeliest = int(probabilities.argmax())
    for level in (coverage, max(coverage, _STRICT)):
        held = model.holds(probabilities[None], level)[0] & possible
        if held.any() and level == coverage:
            held[likeliest] = True
            classes = tuple(c for c, keep in zip(model.classes, held, strict=True) if keep)
            return _ClassSet(classes, "", False)
        if held.any():
            words = (
                f"Unlike every class at {coverage:.0%}: {model.classes[likeliest]} is the most "
                f"probable, but less so than in {coverage:.0%} of the cases that are of it."
            )
            return _ClassSet((), words, False)
    words = (
        f"it is unlike every class at {max(coverage, _STRICT):.1%}: none is as probable as in "
        "nearly all cases that are of it. Look at the recording"
    )
    return _ClassSet((), words, True)


def _few_cases(model: Model, coverage: float) -> tuple[str, ...]:
    """Name classes that no set can rule out."""
    few = model.too_few(coverage)
    if not few:
        return ()
    note = (
        f"Too few cases to rule out {', '.join(few)} at a coverage of {coverage:.3g}: every class "
        f"set holds {'it' if len(few) == 1 else 'them'}."
    )
    return (note,)
