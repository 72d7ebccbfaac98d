"""The answer of a model for a motion: a class and what moved it, or the reason for none."""

import hashlib
import math
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.arguments.checking import Plotted, Saved
from modalmotion.classification.card import tuples_of
from modalmotion.classification.model import Model, Readable, holds
from modalmotion.classification.model_files import (
    DEFAULT_MODEL,
    NORMAL_DISPLACEMENT_MODEL,
    load_model,
    shipped_for,
)
from modalmotion.classification.motion import Motion
from modalmotion.classification.motion_features import AXIS, VOLUME, volume_share, waves_of
from modalmotion.classification.outliers import OUT_OF_DOMAIN, UNREADABLE, Flag
from modalmotion.hdf5.image import ANY_IDS, Dataset, Form, Ids, json_text
from modalmotion.mesh import spring_modes
from modalmotion.mesh.sequence import MEAN, MeshSequence
from modalmotion.modes.topologies import CYLINDER
from modalmotion.notes import Note, notes_from_json
from modalmotion.representation import Floats, Ints, shown
from modalmotion.signature.making import (
    ModalSignature,
    SignatureKind,
    SignatureParameters,
    modal_signature,
    provenance,
)
from modalmotion.signature.value import first_modes

# Level at which a case that is in no set is like no class.
_STRICT: Final = 0.995

# Of the amplitudes: above it probabilities were too sure (docs/decisions/0039).
_UNSURE: Final = 0.2

# Of the motion of a mode, for the derivative by it; and the share of all motion below which modes
# count as still.
_GROWTH: Final = 1e-6
_STILL: Final = 1e-3
# The same share of what is the rounding of modes that do not move.
_ROUNDING: Final = 1e-12

# Parameters that signatures must share with those of the model.
_SAME: Final = ("remove_rotation", "components")


@shown()
@dataclass(frozen=True)
class ModeContribution:
    """Effect of one mode, or of a cosine-sine pair, on a prediction.

    Parameters
    ----------
    modes : tuple of str
        Labels of the modes.
    score : float
        Contribution of their amplitudes to the log of (probability of the most probable class over
        that of the next), beyond those of an average training case.
    amplitude : float, `unit`
        RMS over time of their deviation from the temporal mean.
    per_unit : float
        Change of the same logarithm for a unit more of that amplitude, to first order, the motion
        of the modes growing evenly and the volume as it is; 0 where that is less than a thousandth
        of the motion.
    unit : str or None
    """

    modes: tuple[str, ...]
    score: float
    amplitude: float
    per_unit: float
    unit: str | None


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
    notes : tuple of Note
        Why it abstains, and what a user should know of the model.
    provenance : dict
        Versions of the software that made it.
    """

    sequence_id: str
    model: str
    model_id: str
    label: str | None
    classes: tuple[str, ...]
    probabilities: Floats
    class_set: tuple[str, ...]
    coverage: float
    flags: tuple[str, ...]
    explanation: tuple[ModeContribution, ...]
    notes: tuple[Note, ...]
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
    if not 0.0 < coverage < 1.0:
        raise errors.ParameterError(
            f"The coverage is {coverage!r}.",
            remedy="Use a share above 0 and below 1, such as 0.9.",
            details={"coverage": str(coverage)},
        )
    if model is None:
        model = load_model(shipped_for(DEFAULT_MODEL, motion.facts))
    signature = motion
    if isinstance(signature, MeshSequence):
        signature = fitted_in(model.readable, signature)
    refusal = _unreadable(signature, model)
    if refusal is not None:
        return _answer(signature, model, coverage, (refusal,))
    read = Motion(first_modes(signature, model.readable.n_modes))
    if read.volumes is None and any(table.what == VOLUME for table in model.tables):
        return _answer(signature, model, coverage, (_NO_VOLUME,))
    flags = model.outliers.flags(read)
    if flags:
        return _answer(signature, model, coverage, flags)
    features, share = model.features(read), volume_share(read)
    probabilities, ruled_out = model.probabilities(features[None])[0], model.contradicts(share)
    if ruled_out.all():
        words = f"it loses {share:.0%} of its volume, which no class of the model does. Look at it"
        return _answer(signature, model, coverage, (Flag(OUT_OF_DOMAIN, words),))
    likeliest = int(probabilities.argmax())
    notes = _notes(signature, model)
    if ruled_out[likeliest]:
        low, high = model.shares[likeliest]
        notes.append(
            Note.of(
                "class_ruled_out", label=model.classes[likeliest], share=share, low=low, high=high
            )
        )
    probabilities = np.where(ruled_out, 0.0, probabilities)
    probabilities = probabilities / probabilities.sum()
    label = model.classes[int(probabilities.argmax())]
    held, strict = (
        holds(model.strangeness, probabilities[None], level)[0] & (probabilities > 0.0)
        for level in (coverage, max(coverage, _STRICT))
    )
    if not strict.any():
        words = (
            f"it is unlike every class at {max(coverage, _STRICT):.1%}: none is as probable as in "
            "nearly all cases that are of it. Look at the recording"
        )
        return _answer(signature, model, coverage, (Flag(OUT_OF_DOMAIN, words),))
    if held.any():
        # The label is in the set wherever another class is.
        held[int(probabilities.argmax())] = True
    else:
        notes.append(Note.of("unlike_all", coverage=coverage, label=label))
    notes += [*model.notes.get(label, ()), *model.notes.get("", ())]
    few = model.too_few(coverage)
    if few:
        notes.append(
            Note.of(
                "too_few_to_rule_out",
                classes=", ".join(few),
                coverage=coverage,
                them="it" if len(few) == 1 else "them",
            )
        )
    return replace(
        _answer(signature, model, coverage, ()),
        label=label,
        probabilities=probabilities,
        class_set=tuple(c for c, keep in zip(model.classes, held, strict=True) if keep),
        explanation=_explanation(features, model, read, probabilities),
        notes=tuple(notes),
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
        except errors.TopologyError:
            signature = modal_signature(sequence, replace(readable.parameters, topology=None))
            imposed = readable.imposed_on(signature.surface, sequence.topology)
    except errors.ModeCountError as error:
        raise errors.ModeCountError(
            f"The model reads {readable.n_modes} modes, and these vertices determine "
            f"fewer. {error.message}",
            remedy="Send a finer mesh, or train a model on recordings like this one: it reads as "
            "many modes as they have.",
            details=error.details,
        ) from error
    with suppress(errors.TopologyError):
        return signature if imposed is None else modal_signature(sequence, imposed)
    return signature


def signature_in(
    readable: Readable, motion: MeshSequence | ModalSignature, name: str
) -> ModalSignature:
    """Fit a sequence in modes that are known, or check that a signature is in them.

    Raises
    ------
    UnlikeCasesError
        If it does not compare.
    ModalMotionError
        If it cannot be fitted. Errors call it by its name.
    """
    try:
        signature = fitted_in(readable, motion) if isinstance(motion, MeshSequence) else motion
        if (reason := unlike(signature, readable)) is not None:
            raise errors.UnlikeCasesError(
                f"It does not compare with the others: {reason.words}.",
                remedy="Give the sequence itself, which is then fitted as the others were.",
                details={"sequence_id": signature.sequence_id},
            )
    except errors.ModalMotionError as error:
        raise errors.named(error, name) from error
    return signature


def unlike(signature: ModalSignature, readable: Readable) -> Flag | None:
    """Give the reason why a signature is not readable; None if it is."""
    own, required, modes = signature.parameters, readable.parameters, signature.modes
    n, n_own, what = readable.n_modes, spring_modes.common_count(modes), UNREADABLE
    if signature.n_frames < 2:
        words = "one frame shows no motion. Send at least two"
    elif signature.kind != required.kind:
        words = (
            f"the model reads signatures of the kind {required.kind}, and this one is of the kind "
            f"{signature.kind}, which do not compare. Fit it with kind={required.kind}"
        )
    elif signature.surface != readable.topology:
        remedy = "State the topology if it is wrong"
        if readable.closes_apices and signature.surface == CYLINDER.name:
            remedy = "Fit it with topology=cup, as a cup of which the apex was cut off"
        what = OUT_OF_DOMAIN
        words = (
            f"the model reads signatures of the topology {readable.topology}, this one's is "
            f"{signature.surface}. {remedy}"
        )
    elif modes.connectivity_id != readable.connectivity_id:
        what = OUT_OF_DOMAIN
        words = (
            "the model reads recordings of one mesh only, and this is another: spring modes do not "
            "compare between meshes. Send it on that mesh, or train a model with a topology that "
            "all surfaces have (topology)"
        )
    elif n_own < n:
        words = (
            f"the model reads the first {n} modes of a {signature.surface}, and this signature has "
            f"{n_own}. Fit it with {n} modes, and send a finer mesh if it is too coarse"
        )
    elif any(getattr(own, k) != getattr(required, k) for k in _SAME):
        asked = ", ".join(f"{k} = {getattr(required, k)}" for k in _SAME)
        words = f"the model reads signatures with {asked}. Fit it with the model's parameters"
    else:
        return None
    return Flag(what, words)


_NO_VOLUME: Final = Flag(
    UNREADABLE,
    "the model reads the volume of a cavity, which this signature lacks or which turns inside "
    "out. Fit a cup-shaped surface, or state its cavity, with the model's signature parameters",
)


def _unreadable(signature: ModalSignature, model: Model) -> Flag | None:
    """Flag and reason why the signature cannot be read by the model at all."""
    reason = unlike(signature, model.readable)
    if reason is not None:
        if model.name == NORMAL_DISPLACEMENT_MODEL and signature.kind == SignatureKind.MATERIAL:
            text = ", or state tracking=material if its points follow the tissue"
            reason = reason._replace(words=reason.words + text)
        return reason
    landmarks = signature.landmarks
    if model.walls and (landmarks is None or "theta_zero" in landmarks.weak):
        return Flag(
            UNREADABLE,
            "the model distinguishes walls, but the zero of theta is not determined by "
            "this shape. State the landmark theta_zero",
        )
    if not Motion(signature).size > 0.0:
        return Flag(
            UNREADABLE,
            "the surface is collapsed in its reference frame. Send it with the model's reference",
        )
    return None


def _notes(signature: ModalSignature, model: Model) -> list[Note]:
    """Note what a user should know of the recording."""
    notes = []
    if model.name == NORMAL_DISPLACEMENT_MODEL and signature.facts.tracking == mesh.UNKNOWN:
        notes.append(Note.of("tracking_unknown"))
    share = signature.deviation_share
    if share:
        unsure = ", which the probabilities do not contain: they are too sure"
        consequence = unsure if share >= _UNSURE else ""
        notes.append(Note.of("amplitudes_uncertain", share=share, consequence=consequence))
    if model.signature_parameters.reference == MEAN != signature.parameters.reference:
        notes.append(Note.of("measured_from_frame"))
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
        notes=(
            *(Note.of("no_class", reason=flag.words) for flag in flags),
            *model.notes.get("", ()),
        ),
        provenance=provenance(),
    )


def _explanation(
    features: Floats, model: Model, motion: Motion, probabilities: Floats
) -> tuple[ModeContribution, ...]:
    """Contributions of the modes to a prediction, the strongest first.

    Scores are linear in the features, so contributions beyond an average case add up to the whole;
    features of several modes belong to none of them.
    """
    first, second = np.argsort(-probabilities, kind="stable")[:2]
    weights = model.weights[:, first] - model.weights[:, second]
    lead = (features - model.centre) * weights
    signature = motion.signature
    moving = signature.amplitudes - signature.amplitudes.mean(axis=0)
    squares = np.einsum("fmi,fmi->m", moving, moving) / signature.n_frames
    labels, of_group = _groups(motion.modes)
    reads = model.reads @ of_group > 0.0
    alone = reads & (reads.sum(axis=1, keepdims=True) == 1)
    scores, sizes = (lead @ alone).tolist(), np.sqrt(squares @ of_group).tolist()
    # About an axis each feature is of one group, and of no other's size: all grow at once.
    at_once = all(table.what in (AXIS, VOLUME) for table in model.tables)
    every = _by_growth(model, motion, np.arange(len(motion.modes)), features)
    parts = []
    motion_rms = math.sqrt(squares.sum())
    for k in np.flatnonzero(alone.any(axis=0)).tolist():
        per_unit, size = 0.0, sizes[k] if sizes[k] > _ROUNDING * motion_rms else 0.0
        if size > _STILL * motion_rms:
            own = np.flatnonzero(of_group[:, k])
            change = every * alone[:, k] if at_once else _by_growth(model, motion, own, features)
            per_unit = float(change @ weights) / size
        parts.append(ModeContribution(labels[k], scores[k], size, per_unit, signature.unit))
    return tuple(sorted(parts, key=lambda part: -abs(part.score)))


@lru_cache(maxsize=32)
def _groups(modes: spring_modes.Modes) -> tuple[list[tuple[str, ...]], Floats]:
    """Labels of modes that are explained together, and which these are, (modes, groups)."""
    groups = waves_of(modes, walls=False).modes
    labels = [tuple(str(modes.labels[k]) for k in group) for group in groups]
    return labels, np.array([[float(k in group) for group in groups] for k in range(len(modes))])


def _by_growth(model: Model, motion: Motion, modes: Ints, features: Floats) -> Floats:
    """Differentiate the features by a factor of the motion of some modes, (features,)."""
    grown = []
    for table in model.tables:
        if table.reads_motion:
            terms = table.terms(motion).copy()
            terms[:, modes[modes < table.n_modes]] *= 1.0 + _GROWTH
            grown.append(table.values_of(terms, motion.modes))
        else:
            grown.append(table.values(motion))
    return (np.concatenate(grown) - features) / _GROWTH


FORM: Final = Form("classification", 5)

_OF_ANSWER: Final[dict[str, type]] = {
    "classes": list,
    "label": object,
    "class_set": list,
    "coverage": float,
    "flags": list,
    "notes": list,
    "provenance": dict,
}


def classification_key(
    parameters: SignatureParameters,
    coverage: float,
    tracking: str = mesh.UNKNOWN,
    handedness: str = mesh.UNKNOWN,
    cavity: str = mesh.UNKNOWN,
) -> str:
    """Short name of a request to a model.

    Parameters
    ----------
    parameters : SignatureParameters
        Of the signature.
    coverage : float
        Of the class set.
    tracking : str
        What the points follow, where the answer's notes depend on it.
    handedness, cavity : str
        Of the coordinates, and what the surface encloses: facts that answers depend on.
    """
    facts = [f" {one}" for one in (tracking, handedness, cavity) if one != mesh.UNKNOWN]
    text = f"{parameters.key} {coverage!r}{''.join(facts)}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def classification_to_hdf5(
    classification: Classification, *, parameters_key: str | None = None
) -> bytes:
    """Write a classification as a sealed HDF5 file in memory.

    Parameters
    ----------
    classification : Classification
    parameters_key : str, optional
        Key of the request; see `classification_key`.

    Returns
    -------
    bytes
        The same for the same classification.

    Raises
    ------
    StoreError
        If the name of the model is not a text that HDF5 can contain.
    """
    ids = {"sequence_id": classification.sequence_id, "model_id": classification.model_id}
    if parameters_key is not None:
        ids["parameters_key"] = parameters_key
    datasets = [
        Dataset("probabilities", classification.probabilities, "1", "class"),
        *(json_text(name, getattr(classification, name)) for name in _OF_ANSWER),
        json_text("explanation", [asdict(part) for part in classification.explanation]),
    ]
    return FORM.image(ids, datasets, model=classification.model)


def classification_from_hdf5(source: bytes | Path, ids: Ids = ANY_IDS) -> Classification:
    """Read a classification, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path
    ids : mapping
        Attributes that it must have.

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    with FORM.read(source, ids) as contents:
        texts = {name: tuples_of(contents.json(name, kind)) for name, kind in _OF_ANSWER.items()}
        if (label := texts["label"]) not in (None, *texts["classes"]):
            raise ValueError(f"the label {str(label)[:80]!r} is not one of the classes")
        texts["notes"] = notes_from_json(contents.json("notes", list))
        return Classification(
            sequence_id=contents.text("sequence_id"),
            model=contents.text("model"),
            model_id=contents.text("model_id"),
            probabilities=contents.array("probabilities", (len(texts["classes"]),)),
            explanation=tuple(
                ModeContribution(**tuples_of(part)) for part in contents.json("explanation", list)
            ),
            **texts,
        )
