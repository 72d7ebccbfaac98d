"""The trade of accuracy for numbers and time on one sequence, and the requested point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from modalmotion.arguments.tasks import Plotted
from modalmotion.choice.fitter import Fitter
from modalmotion.choice.harmonics import harmonics_of, require_harmonics
from modalmotion.choice.limit import limit_of, require_unit
from modalmotion.choice.noise import Noise
from modalmotion.choice.parameters import SignatureParameters
from modalmotion.choice.scene import Scene, scene_of
from modalmotion.fit.basis import make_basis
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.signature.making import (
    modal_signature,
    resolve_parameters,
    resolve_sequence,
    resolve_template,
)
from modalmotion.stopwatch import Stopwatch
from modalmotion.template import Template, choose_modes
from modalmotion.template.body_frame import Components
from modalmotion.tradeoff.chosen import Chosen, fewest_numbers, of_signature
from modalmotion.tradeoff.front import MOST_OF_FRONT, Branch, Front, measure_front

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
            limit = limit_of(parameters, own, first)
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
