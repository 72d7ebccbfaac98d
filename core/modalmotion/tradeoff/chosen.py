"""The point of a front that answers a request."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from modalmotion.choice.limit import simplest
from modalmotion.choice.parameters import ErrorKind, ModeOrder, SignatureParameters
from modalmotion.choice.scene import NUMBERS, LinearMotion, Scene, SceneKind
from modalmotion.errors import ToleranceError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numerals import counted, with_article
from modalmotion.representation import shown
from modalmotion.signature.making import modal_signature
from modalmotion.signature.value import ModalSignature
from modalmotion.template import Template
from modalmotion.tradeoff.front import Branch, Front
from modalmotion.tradeoff.price import Price, price_of, priced

# A rotation of each frame goes with the amplitudes.
_ROTATION: Final = 3


@shown("kind", "price.rms_error:price.unit", "price.amplitudes_per_frame", "signature")
@dataclass(frozen=True, eq=False)
class Chosen:
    """The point of a front that answers a request.

    Parameters
    ----------
    kind : SceneKind
        deformable for modes; otherwise the simpler kind of motion that holds.
    signature : ModalSignature or None
        The modes' own; None where a linear motion was chosen.
    motion : LinearMotion or None
        The static, rigid or affine motion that was chosen in place of modes.
    price : Price
    notes : tuple of str
        How it differs from the signature of the same request, if it does.
    """

    kind: SceneKind
    signature: ModalSignature | None
    motion: LinearMotion | None
    price: Price
    notes: tuple[str, ...] = ()


def fewest_numbers(
    sequence: MeshSequence,
    parameters: SignatureParameters,
    front: Front,
    scene: Scene,
    limit: float,
    template: Template | None,
) -> Chosen:
    """Choose the description that holds a limit with fewest numbers over all frames.

    Rotations count, three numbers a frame, where modes are compared with simpler kinds.

    Parameters
    ----------
    sequence : MeshSequence
    parameters : SignatureParameters
        With a tolerance.
    front : Front
    scene : Scene
    limit : float, length unit
    template : Template or None

    Raises
    ------
    ToleranceError
        If nothing holds it.
    """
    chosen = _fewest(sequence, parameters, front, scene, limit, template)
    return replace(chosen, notes=_notes_on(chosen, parameters, front, limit))


def _notes_on(
    chosen: Chosen, parameters: SignatureParameters, front: Front, limit: float
) -> tuple[str, ...]:
    """Say why a signature of the same tolerance is another model, if it is."""
    own, signature = front.branches[0], chosen.signature
    asked = f"the {own.topology}, {parameters.components} components"
    asked += "" if parameters.harmonics is not None else " and the path over time as it is"
    if signature is None:
        return (
            (
                f"A signature with this tolerance takes modes of {asked}. As "
                f"{with_article(chosen.kind)} motion, which is given here, it takes fewer numbers."
            ),
        )
    found = signature.parameters
    same = (
        signature.surface == own.topology
        and found.components == parameters.components
        and found.harmonics == parameters.harmonics
    )
    if same:
        return ()
    ways = [f"modes={len(signature.modes)}", f"components={found.components}"]
    if signature.surface != own.topology:
        ways.append(f"topology={signature.surface}")
    if found.harmonics is not None:
        ways.append(f"harmonics={found.harmonics}")
    count = ""
    if parameters.tolerance_of != ErrorKind.MAX:
        is_plain = parameters.tolerance_of == ErrorKind.RMS
        held = own.counts[(own.rms if is_plain else own.weighted_rms) <= limit]
        if len(held) and parameters.harmonics is None:
            n = int(held[0])
            count = f": {counted(n, 'mode')}, {front.numbers(n)} numbers"
    return (
        (
            f"A signature with this tolerance keeps {asked}{count}. This one takes fewer, "
            f"{chosen.price.numbers}; ask for it by {', '.join(ways)}."
        ),
    )


def _fewest(
    sequence: MeshSequence,
    parameters: SignatureParameters,
    front: Front,
    scene: Scene,
    limit: float,
    template: Template | None,
) -> Chosen:
    kind = simplest(scene, limit, parameters.tolerance_of)
    linear = _of_motion(getattr(scene, kind.value), front) if kind in NUMBERS else None
    try:
        modal = _fewest_modes(sequence, parameters, front, limit, template)
    except ToleranceError:
        if linear is None:
            raise
        return linear
    if linear is not None:
        numbers = modal.price.numbers + _ROTATION * front.n_frames * parameters.remove_rotation
        if linear.price.numbers <= numbers:
            return linear
    return modal


def of_signature(signature: ModalSignature) -> Chosen:
    """Make the choice of a signature."""
    choice = signature.choice
    kind = SceneKind.DEFORMABLE if choice is None else choice.scene
    return Chosen(kind, signature, None, price_of(signature))


def _of_motion(motion: LinearMotion, front: Front) -> Chosen:
    numbers = NUMBERS[motion.kind]
    price = priced(
        motion.error,
        unit=front.unit,
        condition=1.0,
        amplitudes_per_frame=numbers,
        numbers=numbers * front.n_frames,
        n_frames=front.n_frames,
        n_vertices=front.n_vertices,
    )
    return Chosen(motion.kind, None, motion, price)


def _fewest_modes(
    sequence: MeshSequence,
    parameters: SignatureParameters,
    front: Front,
    limit: float,
    template: Template | None,
) -> Chosen:
    if parameters.tolerance_of == ErrorKind.MAX:
        return _fewest_for_maximum(sequence, parameters, front, limit, template)
    for candidate in _candidates(parameters, front, limit):
        signature = modal_signature(sequence, candidate, template=template)
        if _rms_of(signature, parameters.tolerance_of) <= limit:
            return of_signature(signature)
    # Nothing of the front holds it; larger sets of the first branch may.
    return of_signature(modal_signature(sequence, parameters, template=template))


def _candidates(
    parameters: SignatureParameters, front: Front, limit: float
) -> Iterator[SignatureParameters]:
    """Points of a front that hold a limit as far as rounding tells, fewest numbers first."""
    points = []
    for place, branch in enumerate(front.branches):
        own, joint = branch.rms, branch.joint_rms
        if parameters.tolerance_of == ErrorKind.WEIGHTED_RMS:
            own, joint = branch.weighted_rms, branch.weighted_joint_rms
        errors: dict[int | None, np.ndarray] = {None: own}
        errors |= {h: joint[:, h] for h in range(joint.shape[1])}
        if parameters.harmonics is not None:
            errors = {parameters.harmonics: joint[:, parameters.harmonics]}
        for harmonics, rms in errors.items():
            # The first that holds takes fewest numbers, and the next is for the case that
            # rounding says otherwise.
            for k in np.flatnonzero(rms <= limit * (1.0 + 1e-9))[:2]:
                modes = int(branch.counts[k])
                numbers = front.numbers(modes, harmonics)
                points.append((numbers, float(rms[k]), place, modes, harmonics))
    for _, _, place, modes, harmonics in sorted(points, key=lambda point: point[:4]):
        yield _at(parameters, front, front.branches[place], modes, harmonics)


def _rms_of(signature: ModalSignature, kind: ErrorKind) -> float:
    is_plain = kind == ErrorKind.RMS
    return signature.rms_error if is_plain else signature.weighted_rms_error


def _fewest_for_maximum(
    sequence: MeshSequence,
    parameters: SignatureParameters,
    front: Front,
    limit: float,
    template: Template | None,
) -> Chosen:
    """Choose modes on each branch first, then harmonics: a maximum is known of models only."""
    best, place = None, front.branches[0]
    for branch in front.branches:
        own_parameters = replace(
            parameters, topology=_topology(parameters, front, branch), components=branch.components
        )
        try:
            signature = modal_signature(sequence, own_parameters, template=template)
        except ToleranceError:
            if branch is front.branches[-1] and best is None:
                raise
            continue
        if best is None or len(signature.modes) < len(best.modes):
            best, place = signature, branch
    if best is None:
        best = modal_signature(sequence, parameters, template=template)
    modes = len(best.modes)
    if parameters.harmonics is None and (best.choice is None or best.choice.normal is None):
        for harmonics in range(place.joint_rms.shape[1]):
            if front.numbers(modes, harmonics) >= front.numbers(modes):
                break
            candidate = _at(parameters, front, place, modes, harmonics)
            limited = modal_signature(sequence, candidate, template=template)
            if limited.max_error <= limit:
                return of_signature(limited)
    return of_signature(best)


def _at(
    parameters: SignatureParameters,
    front: Front,
    branch: Branch,
    modes: int,
    harmonics: int | None,
) -> SignatureParameters:
    """Parameters of one point of a front."""
    pool = int(branch.counts[-1]) if parameters.order == ModeOrder.ENERGY else None
    return replace(
        parameters,
        tolerance=None,
        tolerance_share=None,
        modes=modes,
        harmonics=harmonics,
        components=branch.components,
        topology=_topology(parameters, front, branch),
        most_modes=pool,
    )


def _topology(parameters: SignatureParameters, front: Front, branch: Branch) -> str | None:
    return parameters.topology if branch.topology == front.branches[0].topology else branch.topology
