"""Speed for accuracy: cost and error of each choice, measured on the sequence itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np

from modalmotion.arguments.checking import Plotted
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Stopwatch
from modalmotion.representation import shown
from modalmotion.signature.choice import (
    NUMBERS,
    SceneError,
    SceneKind,
    limit_of,
    simple_motions,
)
from modalmotion.signature.fit import Fitter, make_basis
from modalmotion.signature.front import (
    MOST_OF_FRONT,
    Branch,
    Front,
    Price,
    measure_front,
    price_of,
)
from modalmotion.signature.making import (
    modal_signature,
    resolve_parameters,
    resolve_sequence,
    resolve_template,
)
from modalmotion.signature.nested_modes import required_harmonics
from modalmotion.signature.noise import Noise
from modalmotion.signature.parameters import ErrorKind, SignatureParameters
from modalmotion.signature.value import ModalSignature
from modalmotion.template import Template, choose_modes
from modalmotion.template.body_frame import Components


@shown("kind", "price.rms_error:price.unit", "price.amplitudes_per_frame", "signature")
@dataclass(frozen=True, eq=False)
class Chosen:
    """The point of a front that answers a request.

    Parameters
    ----------
    signature : ModalSignature
    price : Price
    notes : tuple of str
        How it differs from the signature of the same request, if it does.
    """

    signature: ModalSignature
    price: Price
    notes: tuple[str, ...] = ()

    @property
    def kind(self) -> SceneKind:
        """Simplest kind of motion that the scene is."""
        choice = self.signature.choice
        return SceneKind.DEFORMABLE if choice is None else choice.scene


def _fewest_numbers(
    sequence: MeshSequence,
    parameters: SignatureParameters,
    front: Front,
    limit: float,
    template: Template | None,
) -> Chosen:
    """Choose the signature that holds a limit with fewest numbers over all frames.

    Of modes, harmonics, components and topology together; a largest error is known of signatures
    only, and the requested one is taken.
    """
    asked = modal_signature(sequence, parameters, template=template)
    is_static = asked.choice is not None and asked.choice.scene == SceneKind.STATIC
    if parameters.tolerance_of == ErrorKind.MAX or is_static:
        return Chosen(asked, price_of(asked))
    points = []
    for branch in front.branches:
        is_plain = parameters.tolerance_of == ErrorKind.RMS
        own = branch.rms if is_plain else branch.weighted_rms
        joint = branch.joint_rms if is_plain else branch.weighted_joint_rms
        errors: dict[int | None, np.ndarray] = {None: own, **dict(enumerate(joint.T))}
        if parameters.harmonics is not None:
            errors = {parameters.harmonics: errors[parameters.harmonics]}
        is_own = branch.topology == front.branches[0].topology
        topology = parameters.topology if is_own else branch.topology
        for harmonics, rms in errors.items():
            for k in np.flatnonzero(rms <= limit)[:1]:
                modes = int(branch.counts[k])
                point = replace(
                    parameters,
                    tolerance=None,
                    modes=modes,
                    harmonics=harmonics,
                    components=branch.components,
                    topology=topology,
                )
                points.append((front.numbers(modes, harmonics), float(rms[k]), point))
    own_price = price_of(asked)
    for numbers, _, point in sorted(points, key=lambda one: one[:2]):
        if numbers >= own_price.numbers:
            break
        other = modal_signature(sequence, point, template=template)
        # Errors of a front are right to rounding.
        if (other.rms_error if is_plain else other.weighted_rms_error) <= limit:
            ways = [f"modes={point.modes}", f"components={point.components}"]
            ways += [f"topology={point.topology}"] if point.topology else []
            ways += [f"harmonics={point.harmonics}"] if point.harmonics is not None else []
            note = (
                f"A signature with this tolerance keeps {len(asked.modes)} modes of the "
                f"{asked.surface}, {parameters.components} components: {own_price.numbers} "
                f"numbers. This one takes fewer, {numbers}; ask for it by {', '.join(ways)}."
            )
            return Chosen(other, price_of(other), (note,))
    return Chosen(asked, own_price)


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
    scene : dict of SceneKind to SceneError
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
    scene: dict[SceneKind, SceneError]
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
    watch: Stopwatch | None = None,
) -> Tradeoff:
    """Measure the front of a sequence and choose the point that parameters ask for.

    A stated number of modes is taken on the sequence's own topology. A tolerance takes the
    fewest numbers that hold it over all of the front: modes, harmonics, components and
    topology together. `auto` takes the sequence's own topology and its path over time as it is.

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
    limit = None if parameters.tolerance is None else limit_of(parameters, sequence)
    watch = watch or Stopwatch()
    own = resolve_sequence(sequence, parameters)
    with watch.stage("template") as report:
        used = resolve_template(own, resolve_parameters(own, parameters), template, report)
        fitter = Fitter.of(own, used, parameters)
        required_harmonics(fitter)
    with watch.stage("front"):
        front = measure_front(
            sequence, parameters, most_modes=most_modes, components=components, template=template
        )
    with watch.stage("scene"):
        first = fitter.fit(make_basis(used, choose_modes(used, 1, own.grid)[0]))
        scene = {k: SceneError.of(each) for k, each in simple_motions(fitter, first).items()}
    with watch.stage("choice"):
        if limit is not None:
            chosen = _fewest_numbers(sequence, parameters, front, limit, template)
        else:
            signature = modal_signature(sequence, parameters, template=template)
            chosen = Chosen(signature, price_of(signature))
    choice = chosen.signature.choice
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
        modes = choose_modes(fitter.template, count, fitter.sequence.grid)[0]
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
            kind.value: {**asdict(error), "numbers_per_frame": NUMBERS[kind]}
            for kind, error in tradeoff.scene.items()
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
    signature = chosen.signature
    return {
        "kind": chosen.kind.value,
        "price": asdict(chosen.price),
        "topology": signature.surface,
        "components": signature.parameters.components.value,
        "modes": len(signature.modes),
        "labels": [str(label) for label in signature.modes.labels],
        "harmonics": signature.parameters.harmonics,
        "notes": [*signature.notes, *chosen.notes],
    }
