"""Speed for accuracy: cost and error of each choice, measured on the sequence itself."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np

from modalmotion import errors, notes, progress
from modalmotion.arguments.checking import Plotted, whole
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.modes.topologies import CUP, CYLINDER, MESH, PLANE, Topology
from modalmotion.representation import Floats, Ints, shown
from modalmotion.signature import making
from modalmotion.signature.choice import NUMBERS, SceneError, SceneKind, limit_of, simple_motions
from modalmotion.signature.fit import Fitter, make_basis
from modalmotion.signature.nested_modes import (
    energies_of,
    harmonics_of,
    nested_modes,
    numbers_of_path,
    required_harmonics,
)
from modalmotion.signature.noise import Noise
from modalmotion.signature.parameters import ErrorKind, SignatureKind, SignatureParameters
from modalmotion.signature.value import ModalSignature
from modalmotion.template import Template, choose_modes
from modalmotion.template.body_frame import Components

MOST_OF_FRONT = 111
"""Default number of modes of a front's largest set."""


@shown()
@dataclass(frozen=True, eq=False)
class Branch:
    """RMS errors of all whole sets of one topology and one choice of components.

    Parameters
    ----------
    topology : str
        Or "mesh" for the spring modes of the mesh itself.
    components : Components
    counts : (sets,) int64
        Numbers of modes.
    rms : (sets,) float64, length unit
        Over all vertices and frames; the path of each amplitude over time as it is.
    joint_rms : (sets, harmonics + 1) float64, length unit
        With that path limited to 0, 1, 2, ... harmonics.
    condition : float
        Of the largest set.
    ends_because : str
        Why there is no larger set, where the surface and not the request ended it.
    """

    topology: str
    components: Components
    counts: Ints
    rms: Floats
    joint_rms: Floats
    condition: float
    ends_because: str


@shown("n_frames", "n_vertices", "motion_rms:unit", "branches")
@dataclass(frozen=True, eq=False)
class Front:
    """Error of every choice of modes, harmonics, components and topology.

    Parameters
    ----------
    branches : tuple of Branch
        The sequence's own topology and the requested components come first.
    n_frames, n_vertices : int
    unit : str or None
    motion_rms : float, length unit
        RMS displacement over all frames: the RMS error with no modes.
    """

    branches: tuple[Branch, ...]
    n_frames: int
    n_vertices: int
    unit: str | None
    motion_rms: float

    def numbers(self, modes: int, harmonics: int | None = None) -> int:
        """Amplitudes of the whole trajectory, limited to harmonics or not."""
        return 3 * modes * numbers_of_path(self.n_frames, harmonics)


def _other_topologies(fitter: Fitter) -> tuple[Topology, ...]:
    """Topologies besides a template's own that may fit its surface."""
    own, grid, parameters = fitter.template.surface, fitter.sequence.grid, fitter.parameters
    if parameters.fixes_kind or own is None:
        return ()
    others = {CUP: (CYLINDER,), CYLINDER: (CUP,), PLANE: (CUP,)}.get(own, ())
    if grid is None:
        return others
    return tuple(one for one in others if own != PLANE and (one != CUP or grid[-1] % 2 == 0))


def _front(fitter: Fitter, most_modes: int, components: tuple[Components, ...] | None) -> Front:
    """Measure the RMS error of every whole set, from one factorisation for each topology."""
    sequence, parameters = fitter.sequence, fitter.parameters
    branches, motion = _branches(fitter, most_modes, components)
    for topology in _other_topologies(fitter):
        try:
            other = sequence.with_topology(topology, None)
            template = making.resolve_template(other, making.resolve_parameters(other, parameters))
            fitted = Fitter.of(other, template, parameters)
            branches += _branches(fitted, most_modes, components)[0]
        except errors.InputError:
            # A surface may be laid out in one way only; the others are left out.
            continue
    return Front(tuple(branches), sequence.n_frames, sequence.n_vertices, sequence.unit, motion)


def _branches(
    fitter: Fitter, most_modes: int, components: tuple[Components, ...] | None
) -> tuple[list[Branch], float]:
    """Branches of one topology, the requested components first, and the RMS motion."""
    sequence, template, parameters = fitter.sequence, fitter.template, fitter.parameters
    wanted = components or sorted(Components, key=lambda one: one != parameters.components)
    nested = nested_modes(template, most_modes, sequence.grid)
    counts, functions = nested.counts, harmonics_of(sequence.n_frames, sequence.times)
    branches, motion = [], 0.0
    for one in wanted:
        if one != Components.CARTESIAN and template.landmarks is None and components is None:
            continue
        turned = fitter.asking(components=one)
        fit = turned.fit(nested.basis)
        energies = energies_of(turned, fit, ErrorKind.RMS)
        branches.append(
            Branch(
                topology=MESH if template.surface is None else template.surface.name,
                components=one,
                counts=counts,
                rms=energies.rms(counts),
                joint_rms=energies.joint_rms(counts, functions),
                condition=nested.basis.condition,
                ends_because=nested.ends_because,
            )
        )
        motion = fit.motion.over_frames(ErrorKind.RMS)
    return branches, motion


@shown("rms_error:unit", "max_error:unit", "amplitudes_per_frame", "bytes", "compression")
@dataclass(frozen=True)
class Price:
    """Cost and error of a description of a motion.

    Parameters
    ----------
    rms_error : float, mm
        Over all vertices and frames. All errors are in mm, or in the length unit where that is
        unknown.
    weighted_rms_error : float, mm
        Over the surface and all frames.
    p95_error : float, mm
        95th percentile over the vertices in the worst frame.
    max_error : float, mm
        Of any vertex in any frame.
    unit : str or None
        "mm", or None where the unit of the input is unknown.
    condition : float
        Factor of the data's precision that the amplitudes may lose.
    amplitudes_per_frame : int
    numbers : int
        Of the whole trajectory: amplitudes of all frames, or of all harmonics.
    bytes : int
        Of these numbers as float64, which is how they are stored.
    bytes_float32 : int
        Of these numbers as float32.
    compression : float
        Coordinates over amplitudes of one frame, as in Nastar 1994.
    compression_of_sequence : float
        Numbers in the sequence over those to keep: trajectory and reference.
    milliseconds : mapping of str to float
        By stage, where they were measured. Results do not store them.
    """

    rms_error: float
    weighted_rms_error: float
    p95_error: float
    max_error: float
    unit: str | None
    condition: float
    amplitudes_per_frame: int
    numbers: int
    bytes: int
    bytes_float32: int
    compression: float
    compression_of_sequence: float
    milliseconds: Mapping[str, float] = field(default_factory=dict)


def price_of(signature: ModalSignature, milliseconds: Mapping[str, float] | None = None) -> Price:
    """Give the price of a signature.

    Parameters
    ----------
    signature : ModalSignature
    milliseconds : mapping of str to float, optional
        Times measured during the fit.
    """
    f, harmonics = signature.n_frames, signature.parameters.harmonics
    numbers = signature.n_amplitudes * numbers_of_path(f, harmonics)
    coordinates = 3 * signature.n_vertices
    factor = 1.0 if signature.unit is None else MM_PER_UNIT[signature.unit]
    return Price(
        rms_error=factor * signature.rms_error,
        weighted_rms_error=factor * signature.weighted_rms_error,
        p95_error=factor * float(signature.p95_errors.max()),
        max_error=factor * signature.max_error,
        unit=None if signature.unit is None else "mm",
        condition=signature.condition,
        amplitudes_per_frame=signature.n_amplitudes,
        numbers=numbers,
        bytes=8 * numbers,
        bytes_float32=4 * numbers,
        compression=signature.compression,
        compression_of_sequence=f * coordinates / (numbers + coordinates),
        milliseconds=dict(milliseconds or {}),
    )


# Sets whose fits are timed, the largest and ever smaller ones.
_TIMED: Final = 5
_REPEATS: Final = 2


@shown("kind", "price.rms_error:price.unit", "price.amplitudes_per_frame", "signature")
@dataclass(frozen=True, eq=False)
class Chosen:
    """The requested signature.

    Parameters
    ----------
    signature : ModalSignature
    price : Price
        Cost and error.
    """

    signature: ModalSignature
    price: Price

    @property
    def kind(self) -> SceneKind:
        """Simplest kind of motion that the scene is."""
        choice = self.signature.choice
        return SceneKind.DEFORMABLE if choice is None else choice.scene


@shown(
    "chosen.kind",
    "chosen.price.rms_error:chosen.price.unit",
    "limit",
    "front.n_frames",
    "sequence_id",
)
@dataclass(frozen=True, eq=False)
class Tradeoff(Plotted):
    """Cost and error of each choice on one sequence, and the requested one.

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
    watch: progress.Stopwatch | None = None,
) -> Tradeoff:
    """Measure error and cost of all sets of modes, and of the requested signature.

    Parameters
    ----------
    sequence : MeshSequence
    parameters : SignatureParameters, optional
        7 modes by default. A topology that they state is the only one measured; otherwise all
        that fit the surface are.
    most_modes : int
        Modes of the front's largest set; fewer if the vertices do not distinguish so many.
    components : tuple of Components, optional
        All that the surface has by default.
    template : Template, optional
        The one that the parameters name; made from the sequence's own reference by default.
    watch : Stopwatch, optional
        Told of the stages `template`, `front`, `scene`, `choice` and `timing`.

    Raises
    ------
    ToleranceError
        If no set of modes keeps the tolerance.
    ParameterError
        If a tolerance is in mm and the unit of the sequence unknown, or normal displacements are
        requested.
    """
    parameters = SignatureParameters() if parameters is None else parameters
    if parameters.kind == SignatureKind.NORMAL_DISPLACEMENT:
        raise errors.ParameterError(
            "The trade-off is measured for displacements, but normal displacements were requested.",
            remedy="Omit kind, or request the signature itself with a tolerance: its errors are "
            "those of the normal displacements.",
        )
    most_modes = whole("most_modes", most_modes)
    limit = None if parameters.tolerance is None else limit_of(parameters, sequence)
    watch = watch or progress.Stopwatch()
    own = making.resolve_sequence(sequence, parameters)
    with watch.stage("template") as report:
        used = making.resolve_template(
            own, making.resolve_parameters(own, parameters), template, report
        )
        fitter = Fitter.of(own, used, parameters)
        required_harmonics(fitter)
    with watch.stage("front"):
        front = _front(fitter, most_modes, components)
    with watch.stage("scene"):
        first = fitter.fit(make_basis(used, choose_modes(used, 1, own.grid)[0]))
        scene = {k: SceneError.of(each) for k, each in simple_motions(fitter, first).items()}
    with watch.stage("choice"):
        signature = making.modal_signature(sequence, parameters, template=template)
    choice = signature.choice
    with watch.stage("timing"):
        times = _fit_milliseconds(fitter, front.branches[0])
    return Tradeoff(
        sequence_id=sequence.id,
        parameters=parameters,
        front=front,
        scene=scene,
        limit=limit if choice is None else choice.limit,
        noise=None if choice is None else choice.noise,
        chosen=Chosen(signature, price_of(signature, watch.milliseconds)),
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
            watch = progress.Stopwatch()
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
        "harmonics": list(range(branch.joint_rms.shape[1])),
        "rms_by_harmonics": branch.joint_rms.tolist(),
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
        "notes": notes.notes_as_json(signature.notes),
    }
