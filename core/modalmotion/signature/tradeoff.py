"""Speed for accuracy: cost and error of each choice, measured on the sequence itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np

from modalmotion.arguments.checking import Plotted
from modalmotion.errors import ToleranceError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Stopwatch
from modalmotion.representation import counted, shown, with_article
from modalmotion.signature.basis import make_basis
from modalmotion.signature.fitter import NUMBERS, Fitter, LinearMotion, Scene, SceneKind, scene_of
from modalmotion.signature.front import (
    MOST_OF_FRONT,
    Branch,
    Front,
    Price,
    measure_front,
    price_of,
    priced,
)
from modalmotion.signature.making import (
    modal_signature,
    resolve_parameters,
    resolve_sequence,
    resolve_template,
)
from modalmotion.signature.model import (
    Noise,
    harmonics_of,
    limit_of,
    require_harmonics,
    require_unit,
    simplest,
)
from modalmotion.signature.parameters import ErrorKind, SignatureParameters
from modalmotion.signature.value import ModalSignature
from modalmotion.template import Template, choose_modes
from modalmotion.template.body_frame import Components

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
    return replace(
        parameters,
        tolerance=None,
        modes=modes,
        harmonics=harmonics,
        components=branch.components,
        topology=_topology(parameters, front, branch),
    )


def _topology(parameters: SignatureParameters, front: Front, branch: Branch) -> str | None:
    return parameters.topology if branch.topology == front.branches[0].topology else branch.topology


# Sets whose fits are timed, the largest and ever smaller ones.
_TIMED: Final = 5
_REPEATS: Final = 2


@shown(
    "chosen.kind",
    "chosen.price.rms_error:chosen.price.unit",
    "limit",
    "front.n_frames",
    "sequence_id",
)
@dataclass(frozen=True, eq=False)
class Tradeoff(Plotted):
    """Cost and error of each choice on one sequence, and the requested choice.

    Parameters
    ----------
    sequence_id : str
    parameters : SignatureParameters
        As requested.
    front : Front
    scene : Scene
        The motion measured against each simple kind.
    limit : float or None, length unit
        The error limit; None where the number of modes was stated.
    noise : Noise or None
        The estimate, for `auto`.
    chosen : Chosen
        Its errors are those of the model itself.
    fit_milliseconds : mapping of int to float
        Time to fit so many modes of the first branch, factorisation included, all frames.
    milliseconds : mapping of str to float
        Of this answer, by stage.
    """

    sequence_id: str
    parameters: SignatureParameters
    front: Front
    scene: Scene
    limit: float | None
    noise: Noise | None
    chosen: Chosen
    fit_milliseconds: Mapping[int, float] = field(default_factory=dict)
    milliseconds: Mapping[str, float] = field(default_factory=dict)


def measure_tradeoff(
    sequence: MeshSequence,
    parameters: SignatureParameters | None = None,
    *,
    most_modes: int = MOST_OF_FRONT,
    components: tuple[Components, ...] | None = None,
    template: Template | None = None,
    with_times: bool = True,
    watch: Stopwatch | None = None,
) -> Tradeoff:
    """Measure the front of a sequence and choose the point that parameters ask for.

    A stated number of modes is taken on the sequence's own topology. A tolerance takes the
    fewest numbers that hold it over all of the front: modes, harmonics, components and
    topology together, or a static, rigid or affine motion where that takes fewer. `auto` takes
    the sequence's own topology and its path over time as it is.

    Parameters
    ----------
    sequence : MeshSequence
    parameters : SignatureParameters, optional
        7 modes by default.
    most_modes : int
        Modes of the front's largest set. A tolerance may reach beyond it, if nothing of the
        front holds it.
    components : tuple of Components, optional
        All that the surface has by default.
    template : Template, optional
        The one that the parameters name.
    with_times : bool
        Whether to time the fits of a few sets.
    watch : Stopwatch, optional
        Told of the stages `template`, `front`, `scene`, `choice` and `timing`.

    Raises
    ------
    ToleranceError
        If nothing holds the tolerance.
    ParameterError
        If a tolerance is in mm and the unit of the sequence unknown.
    """
    parameters = SignatureParameters() if parameters is None else parameters
    require_unit(parameters, sequence)
    watch = watch or Stopwatch()
    own = resolve_sequence(sequence, parameters)
    if parameters.harmonics is not None:
        require_harmonics(parameters.harmonics, harmonics_of(own.n_frames, own.times))
    with watch.stage("template") as report:
        used = resolve_template(own, resolve_parameters(own, parameters), template, report)
    with watch.stage("front"):
        front = measure_front(
            sequence, parameters, most_modes=most_modes, components=components, template=template
        )
    with watch.stage("scene"):
        fitter = Fitter.of(own, used, parameters)
        first = fitter.fit(make_basis(used, choose_modes(used, 1, own.grid).modes))
        scene = scene_of(fitter, first.rotations)
    limit = None
    with watch.stage("choice"):
        if parameters.is_adaptive and not parameters.auto:
            limit = limit_of(parameters, own)
            chosen = fewest_numbers(sequence, parameters, front, scene, limit, template)
        else:
            chosen = of_signature(modal_signature(sequence, parameters, template=template))
    choice = None if chosen.signature is None else chosen.signature.choice
    times: dict[int, float] = {}
    if with_times:
        with watch.stage("timing"):
            times = _fit_milliseconds(fitter, front.branches[0])
    return Tradeoff(
        sequence_id=sequence.id,
        parameters=parameters,
        front=front,
        scene=scene,
        limit=limit if choice is None or limit is not None else choice.limit,
        noise=None if choice is None else choice.noise,
        chosen=replace(chosen, price=replace(chosen.price, milliseconds=watch.milliseconds)),
        fit_milliseconds=times,
        milliseconds=watch.milliseconds,
    )


def _fit_milliseconds(fitter: Fitter, branch: Branch) -> dict[int, float]:
    """Time the fit of the largest set and of ever smaller ones."""
    places = np.unique(len(branch.counts) // 2 ** np.arange(_TIMED) - 1)
    times = {}
    for count in branch.counts[places[places >= 0]].tolist():
        modes = choose_modes(fitter.template, count, fitter.sequence.grid).modes
        spent = []
        for _ in range(_REPEATS):
            watch = Stopwatch()
            with watch.stage("fit"):
                fitter.fit(make_basis(fitter.template, modes))
            spent.append(watch.milliseconds["fit"])
        # The quickest is the one that met least other work.
        times[count] = min(spent)
    return times


def as_plain(tradeoff: Tradeoff) -> dict[str, Any]:
    """Write a trade out as dicts, lists, numbers and text.

    Parameters
    ----------
    tradeoff : Tradeoff
    """
    front = tradeoff.front
    return {
        "sequence_id": tradeoff.sequence_id,
        "unit": front.unit,
        "n_frames": front.n_frames,
        "n_vertices": front.n_vertices,
        "motion_rms": front.motion_rms,
        "weighted_motion_rms": front.weighted_motion_rms,
        "front": [_branch(branch, front) for branch in front.branches],
        "scene": {
            kind.value: {**asdict(error), "numbers_per_frame": NUMBERS.get(kind)}
            for kind, error in tradeoff.scene.errors.items()
        },
        "limit": tradeoff.limit,
        "noise": None if tradeoff.noise is None else asdict(tradeoff.noise),
        "chosen": _chosen(tradeoff.chosen),
        "fit_milliseconds": {str(n): ms for n, ms in tradeoff.fit_milliseconds.items()},
        "milliseconds": dict(tradeoff.milliseconds),
    }


def _branch(branch: Branch, front: Front) -> dict[str, Any]:
    return {
        "topology": branch.topology,
        "components": branch.components.value,
        "modes": branch.counts.tolist(),
        "amplitudes_per_frame": (3 * branch.counts).tolist(),
        "bytes": [8 * front.numbers(n) for n in branch.counts.tolist()],
        "rms": branch.rms.tolist(),
        "weighted_rms": branch.weighted_rms.tolist(),
        "harmonics": list(range(branch.joint_rms.shape[1])),
        "rms_by_harmonics": branch.joint_rms.tolist(),
        "weighted_rms_by_harmonics": branch.weighted_joint_rms.tolist(),
        "condition": branch.condition,
        "ends_because": branch.ends_because,
    }


def _chosen(chosen: Chosen) -> dict[str, Any]:
    signature, motion = chosen.signature, chosen.motion
    plain: dict[str, Any] = {
        "kind": chosen.kind.value,
        "price": asdict(chosen.price),
        "notes": list(chosen.notes),
    }
    if signature is not None:
        parameters = signature.parameters
        plain |= {
            "topology": signature.surface,
            "components": parameters.components.value,
            "modes": len(signature.modes),
            "labels": [str(label) for label in signature.modes.labels],
            "harmonics": parameters.harmonics,
            "notes": [*signature.notes, *chosen.notes],
        }
    if motion is not None:
        plain |= {"matrices": motion.matrices.tolist(), "shifts": motion.shifts.tolist()}
    return plain
