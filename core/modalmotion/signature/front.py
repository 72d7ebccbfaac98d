"""Error against the number of amplitudes for every set of modes, and its cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.checking import whole
from modalmotion.errors import InputError, ParameterError
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.modes.topology import CUP, CYLINDER, MESH, PLANE, Topology
from modalmotion.representation import shown
from modalmotion.signature.fit import Fitter
from modalmotion.signature.making import resolve_parameters, resolve_sequence, resolve_template
from modalmotion.signature.nested_modes import (
    energies_of,
    harmonics_of,
    n_functions,
    nested_modes,
)
from modalmotion.signature.parameters import ErrorKind, SignatureKind, SignatureParameters
from modalmotion.signature.value import ModalSignature
from modalmotion.template import Template
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
    rms, weighted_rms : (sets,) float64, length unit
        Over all vertices and frames, and by the vertices' shares of the surface; the path of
        each amplitude over time as it is.
    joint_rms, weighted_joint_rms : (sets, harmonics + 1) float64, length unit
        With that path limited to 0, 1, 2, ... harmonics.
    condition : float
        Of the largest set.
    ends_because : str
        Why there is no larger set, where the surface and not the request ended it.
    """

    topology: str
    components: Components
    counts: NDArray[np.int64]
    rms: NDArray[np.float64]
    joint_rms: NDArray[np.float64]
    weighted_rms: NDArray[np.float64]
    weighted_joint_rms: NDArray[np.float64]
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
    motion_rms, weighted_motion_rms : float, length unit
        RMS displacement over all frames: the RMS errors with no modes.
    """

    branches: tuple[Branch, ...]
    n_frames: int
    n_vertices: int
    unit: str | None
    motion_rms: float
    weighted_motion_rms: float

    def numbers(self, modes: int, harmonics: int | None = None) -> int:
        """Amplitudes of the whole trajectory, limited to harmonics or not."""
        per_path = self.n_frames
        if harmonics is not None:
            per_path = min(n_functions(harmonics), self.n_frames)
        return 3 * modes * per_path


def measure_front(
    sequence: MeshSequence,
    parameters: SignatureParameters | None = None,
    *,
    most_modes: int = MOST_OF_FRONT,
    components: tuple[Components, ...] | None = None,
    template: Template | None = None,
) -> Front:
    """Measure the RMS error of every whole set, from one factorisation for each topology.

    Parameters
    ----------
    sequence : MeshSequence
    parameters : SignatureParameters, optional
        How displacements are measured and ordered. A topology that they state is the only
        one; otherwise all that fit the surface are measured.
    most_modes : int
        Modes of the largest set; fewer if the surface does not tell so many apart.
    components : tuple of Components, optional
        All that the surface has by default.
    template : Template, optional
        The one that the parameters name; made from the sequence's own reference by default.

    Returns
    -------
    Front

    Raises
    ------
    InputError
        If not even the sequence's own topology can be measured.
    """
    parameters = SignatureParameters() if parameters is None else parameters
    if parameters.kind == SignatureKind.OFFSET:
        raise ParameterError(
            "The trade is measured of displacements, and offsets were requested.",
            remedy="Leave the kind out, or ask for the signature itself by tolerance: its errors "
            "are of the offsets.",
        )
    most_modes = whole("most_modes", most_modes)
    own = resolve_sequence(sequence, parameters)
    used = resolve_template(own, resolve_parameters(own, parameters), template)
    branches, *motion = _branches(Fitter.of(own, used, parameters), most_modes, components)
    for topology in other_topologies(own, used, parameters):
        try:
            other = own.with_topology(topology, None)
            other_template = resolve_template(other, resolve_parameters(other, parameters))
            more, *_ = _branches(
                Fitter.of(other, other_template, parameters), most_modes, components
            )
        except InputError:
            # A surface may be laid out in one way only; the others are left out.
            continue
        branches += more
    return Front(tuple(branches), own.n_frames, own.n_vertices, own.unit, *motion)


def other_topologies(
    sequence: MeshSequence, template: Template, parameters: SignatureParameters
) -> tuple[Topology, ...]:
    """Topologies besides a template's own that may fit its surface."""
    own = template.surface
    if parameters.topology is not None or parameters.template is not None or own is None:
        return ()
    others = {CUP: (CYLINDER,), CYLINDER: (CUP,), PLANE: (CUP,)}.get(own, ())
    if sequence.grid is not None:
        is_cup = sequence.grid[-1] % 2 == 0
        return tuple(other for other in others if own != PLANE and (other != CUP or is_cup))
    return others


def _branches(
    fitter: Fitter, most_modes: int, components: tuple[Components, ...] | None
) -> tuple[list[Branch], float, float]:
    """Branches of one topology, and the RMS motion, plain and weighted."""
    sequence, template, parameters = fitter.sequence, fitter.template, fitter.parameters
    all_components = components or tuple(
        sorted(Components, key=lambda one: one != parameters.components)
    )
    nested = nested_modes(template, most_modes, sequence.grid)
    counts, functions = nested.counts, harmonics_of(sequence.n_frames, sequence.times)
    branches, motion, weighted_motion = [], 0.0, 0.0
    for one in all_components:
        if one != Components.CARTESIAN and template.landmarks is None and components is None:
            continue
        turned = fitter.asking(components=one)
        fit = turned.fit(nested.basis)
        plain, weighted = energies_of(turned, fit, ErrorKind.RMS), energies_of(turned, fit)
        branches.append(
            Branch(
                topology=MESH if template.surface is None else template.surface.name,
                components=one,
                counts=counts,
                rms=plain.rms(counts),
                joint_rms=plain.joint_rms(counts, functions),
                weighted_rms=weighted.rms(counts),
                weighted_joint_rms=weighted.joint_rms(counts, functions),
                condition=nested.basis.condition,
                ends_because=nested.ends_because,
            )
        )
        motion = fit.motion.over_frames(ErrorKind.RMS)
        weighted_motion = fit.motion.over_frames(ErrorKind.WEIGHTED_RMS)
    return branches, motion, weighted_motion


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
    per_path = f if harmonics is None else min(n_functions(harmonics), f)
    numbers, coordinates = signature.n_amplitudes * per_path, 3 * signature.n_vertices
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
