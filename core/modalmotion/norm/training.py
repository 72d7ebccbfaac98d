"""Controls of one's own, and the norm that is made of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final

from modalmotion.classification.card import require_model_name
from modalmotion.classification.cases import TrainingCase, as_case
from modalmotion.classification.cohort import alike
from modalmotion.errors import ParameterError
from modalmotion.mesh import Facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm.deviation import LEVEL, fewest_controls
from modalmotion.norm.norm import Norm, reading_of
from modalmotion.notes import Note
from modalmotion.progress import Reporter, reported
from modalmotion.representation import counted
from modalmotion.signature.making import SignatureKind, SignatureParameters

FEWEST_CONTROLS: Final = 9
"""With fewer no p-value is as small as 1/10."""


def train_norm(
    controls: Iterable[Any],
    name: str,
    *,
    modes: int = 7,
    topology: str | None = None,
    progress: Reporter | None = None,
) -> Norm:
    """Make a norm of recordings of people who are taken as usual.

    The modes in which they compare, and whether they are cycles, are decided from all of them
    together. Nothing else is fitted: what is usual is decided anew for each recording that is
    compared, from the controls and that recording.

    Parameters
    ----------
    controls : iterable of TrainingCase, CaseSource, MeshSequence or ModalSignature
        One recording of each person; labels are not read. Volumes are read of sequences, and of
        signatures whose case names its sequence. Those with points that slide
        (`tracking="normal_displacement"`) are read by their normal displacements.
    name : str
        As models are named.
    modes : int
        Of the signatures of sequences.
    topology : str, optional
        Of these signatures; "mesh" for spring modes.
    progress : function, optional
        Called with the number of controls read and of all.

    Raises
    ------
    ParameterError
        If there are too few controls, two of one person, or the name cannot be kept.
    UnlikeCasesError
        If their modes do not compare.
    ModalMotionError
        If one cannot be fitted; it is named.
    """
    # Here, for scikit-learn takes a second, and whoever reads a norm needs none of it.
    from modalmotion.classification.scikit_learn import SignatureFeatures

    require_model_name(name)
    cases = [as_case(one, number) for number, one in enumerate(controls)]
    _require_people(cases)
    transformer = SignatureFeatures(modes=modes, topology=topology)
    parameters = parameters_of_controls(
        transformer.signature_parameters, (case.motion.facts for case in cases)
    )
    signatures = alike(cases, parameters)[0].signatures
    transformer.fit(signatures)
    readings = []
    for case, signature in reported(zip(cases, signatures, strict=True), progress, len(cases)):
        sequence, extractor = case.read_sequence(), transformer.extractor_
        readings.append(
            reading_of(signature, sequence, extractor, subject=case.subject, name=case.name)
        )
    notes = []
    if len(cases) < fewest_controls(LEVEL):
        notes.append(
            Note.of(
                "few_controls",
                controls=counted(len(cases), "control"),
                n_readings=len(cases) + 1,
                level=LEVEL,
                needed=fewest_controls(LEVEL),
            )
        )
    return Norm(
        name=name,
        readable=transformer.readable_,
        extractor=transformer.extractor_,
        columns=tuple(map(str, transformer.get_feature_names_out())),
        controls=tuple(readings),
        notes=tuple(notes),
    )


def parameters_of_controls(
    parameters: SignatureParameters, facts: Iterable[Facts]
) -> SignatureParameters:
    """Choose the kind that controls are read with: normal displacements if points of one slide."""
    if any(one.tracking == SignatureKind.NORMAL_DISPLACEMENT.value for one in facts):
        return replace(parameters, kind=SignatureKind.NORMAL_DISPLACEMENT)
    return parameters


def _require_people(cases: list[TrainingCase]) -> None:
    if len(cases) < FEWEST_CONTROLS:
        raise ParameterError(
            f"A norm of {counted(len(cases), 'control')} is too small.",
            remedy=f"Give at least {FEWEST_CONTROLS}, and {fewest_controls(LEVEL)} for the usual "
            f"level of {LEVEL}.",
            details={"n_controls": len(cases), "needed": FEWEST_CONTROLS},
        )
    seen: dict[str, str] = {}
    for case in cases:
        motion = case.motion
        own = motion.id if isinstance(motion, MeshSequence) else motion.sequence_id
        for key in filter(None, (own, case.subject and f"subject {case.subject}")):
            if key in seen:
                raise ParameterError(
                    f"{case.name} and {seen[key]} are recordings of one person.",
                    remedy="Give one recording of each control: two of one are too much alike.",
                    details={"case": case.name},
                )
            seen[key] = case.name
