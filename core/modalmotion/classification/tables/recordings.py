"""Recordings of a cohort, fitted in modes that all of them share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from modalmotion.classification.answer.classifier import fitted_in
from modalmotion.classification.model.model import Readable
from modalmotion.classification.training.case_reading import basis_of
from modalmotion.classification.training.cases import TrainingCase, named
from modalmotion.errors import (
    ModalMotionError,
    ModeCountError,
    ParameterError,
    TopologyError,
    UnlikeCasesError,
)
from modalmotion.mesh.sequence import MEAN, MeshSequence
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.template import GivenLandmarks

Recording = MeshSequence | ModalSignature


def recordings_of(X: Iterable[Any]) -> list[Recording]:
    """Take the recordings out of cases, sources and the like.

    Parameters
    ----------
    X : iterable of MeshSequence, ModalSignature, TrainingCase or CaseSource

    Raises
    ------
    ParameterError
        If one is none of these; it is named by its number.
    """
    recordings: list[Recording] = []
    for number, item in enumerate(X):
        one = item
        if not isinstance(one, Recording | TrainingCase) and hasattr(one, "read"):
            one = one.read()
        if isinstance(one, TrainingCase):
            one = one.motion
        if not isinstance(one, Recording):
            raise ParameterError(
                f"Item {number} is a {type(one).__name__}, which is no recording.",
                remedy="Give ModalSignatures, MeshSequences or TrainingCases.",
                details={"case": number},
            )
        recordings.append(one)
    return recordings


def in_one_basis(
    recordings: Sequence[Recording], parameters: SignatureParameters, *, mixes_axes: bool
) -> tuple[list[ModalSignature], Readable]:
    """Fit sequences in modes in which all recordings compare.

    As their own shapes say; where that gives modes that do not compare, with the spring modes of
    their mesh, unless the parameters state a topology.

    Parameters
    ----------
    recordings : sequence of MeshSequence or ModalSignature
        Signatures are taken as they are.
    parameters : SignatureParameters
    mixes_axes : bool
        Whether surfaces of several topologies compare if all have an axis.

    Raises
    ------
    UnlikeCasesError
        If they do not compare.
    ModalMotionError
        If one cannot be fitted; it is named by its number.
    """
    signatures = [_fitted(k, one, parameters) for k, one in enumerate(recordings)]
    try:
        return signatures, _readable(signatures, mixes_axes=mixes_axes)
    except UnlikeCasesError as unlike:
        if parameters.topology is not None:
            raise
        springs = replace(parameters, closed_form=False)
        try:
            signatures = [_fitted(k, one, springs) for k, one in enumerate(recordings)]
            return signatures, _readable(signatures, mixes_axes=mixes_axes)
        except (UnlikeCasesError, TopologyError, ModeCountError):
            raise unlike from None


def in_basis(recordings: Sequence[Recording], readable: Readable) -> list[ModalSignature]:
    """Fit sequences in modes that are known, and check signatures.

    Raises
    ------
    UnlikeCasesError
        If one does not compare with them; it is named by its number.
    ModalMotionError
        If one cannot be fitted.
    """
    signatures = []
    for number, one in enumerate(recordings):
        signature = one
        if isinstance(signature, MeshSequence):
            try:
                signature = fitted_in(readable, signature)
            except ModalMotionError as error:
                raise named(error, f"Item {number}") from error
        _require_frames(number, signature)
        own = _readable([signature], mixes_axes=True)
        if signature.surface not in readable.topologies or _unlike(own, readable):
            raise UnlikeCasesError(
                f"Item {number} has {len(signature.modes)} modes of a {signature.surface}, which "
                f"do not compare with the {readable.n_modes} of a "
                f"{' or '.join(readable.topologies)} that were fitted to.",
                remedy="Fit it with the parameters in `readable_.parameters`, or give the sequence "
                "itself.",
                details={"case": number, "sequence_id": signature.sequence_id},
            )
        signatures.append(signature)
    return signatures


def _unlike(a: Readable, b: Readable) -> bool:
    p, q = a.parameters, b.parameters
    return (
        (a.n_modes, a.connectivity_id) != (b.n_modes, b.connectivity_id)
        or (p.weights, p.remove_rotation, p.components)
        != (q.weights, q.remove_rotation, q.components)
        or (p.reference == MEAN) != (q.reference == MEAN)
    )


def _fitted(number: int, one: Recording, parameters: SignatureParameters) -> ModalSignature:
    signature = one
    if isinstance(signature, MeshSequence):
        try:
            signature = modal_signature(signature, parameters)
        except ModalMotionError as error:
            raise named(error, f"Item {number}") from error
    _require_frames(number, signature)
    return signature


def _require_frames(number: int, signature: ModalSignature) -> None:
    if signature.n_frames < 2:
        raise ParameterError(
            f"Item {number} has one frame, which shows no motion.",
            remedy="Leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )


def _readable(signatures: Sequence[ModalSignature], *, mixes_axes: bool) -> Readable:
    first = signatures[0]
    surfaces = Counter(signature.surface for signature in signatures)
    for number, signature in enumerate(signatures):
        is_like = basis_of(signature) == basis_of(first)
        is_like = is_like and len(signature.modes) == len(first.modes)
        if not is_like or (len(surfaces) > 1 and not mixes_axes):
            rare = surfaces.most_common()[-1][0]
            odd = next(k for k, one in enumerate(signatures) if one.surface == rare)
            number = number if not is_like else odd
            raise UnlikeCasesError(
                f"Item {number} has {len(signatures[number].modes)} modes of a "
                f"{signatures[number].surface}, which do not compare with those of the others.",
                remedy="Leave it out, state one topology for all, or give the sequences "
                "themselves: they are fitted in one basis.",
                details={"case": number, "sequence_id": signatures[number].sequence_id},
            )
    parameters = replace(
        first.parameters,
        template=None,
        landmarks=GivenLandmarks(),
        grid=None,
        reference=MEAN if first.parameters.reference == MEAN else 0,
    )
    return Readable(
        topologies=tuple(sorted(surfaces)),
        n_modes=len(first.modes),
        connectivity_id=first.modes.connectivity_id,
        parameters=parameters,
    )
