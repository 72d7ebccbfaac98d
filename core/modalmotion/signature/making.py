"""Making modal signatures."""

import platform
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import version
from typing import Final

import numpy as np

from modalmotion import errors, mesh, progress
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.mesh import alignment, geometry
from modalmotion.mesh.sequence import MeshSequence, Reference
from modalmotion.modes.topologies import PLANE, Topology
from modalmotion.notes import Note
from modalmotion.representation import Floats, Ints, counted, numeral
from modalmotion.signature.choice import choose_fit, notes_on_compactness
from modalmotion.signature.deviations import deviations_of
from modalmotion.signature.fit import Fit, Fitter, make_basis
from modalmotion.signature.nested_modes import limited
from modalmotion.signature.noise_bands import edges_of
from modalmotion.signature.parameters import (
    MOST_MODES,
    USUAL_MODES,
    SignatureKind,
    SignatureParameters,
)
from modalmotion.signature.value import ModalSignature
from modalmotion.template import Template, choose_modes, make_template, require_same_mesh
from modalmotion.template.template import frequencies_of

# Corners of triangles in memory at a time.
_BLOCK: Final = 2**20


def enclosed_volumes(sequence: MeshSequence, template: Template) -> Floats | None:
    """Volume in each frame, each opening closed by a fan to the mean of its vertices.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
        Of the sequence: its triangles are read.

    Returns
    -------
    (frames,) float64, length unit cubed, or None
        Positive where it is largest, for either winding. None where the surface encloses
        nothing, as a curve, a sheet and several pieces do, or where cubes of its size overflow.
    """
    if template.surface == PLANE or not len(template.faces):
        return None
    try:
        cavity = geometry.cavity_of(template.faces, template.n_vertices)
    except errors.TopologyError:
        return None
    n = sequence.n_frames
    volumes = np.empty(n)
    step = max(1, _BLOCK // (3 * len(cavity.faces)))
    with np.errstate(over="ignore", invalid="ignore"):
        for first in range(0, n, step):
            part = sequence.vertices[first : first + step].astype(np.float64)
            volumes[first : first + step] = cavity.volume(part)
    if not np.isfinite(volumes).all():
        return None
    largest = float(volumes[np.abs(volumes).argmax()])
    return volumes * np.sign(largest) if largest else None


__all__ = [
    "INTENDED_USE",
    "MOST_MODES",
    "ModalSignature",
    "SignatureKind",
    "SignatureParameters",
    "modal_signature",
    "provenance",
    "resolve_parameters",
    "resolve_sequence",
    "resolve_template",
]


def modal_signature(
    sequence: MeshSequence,
    parameters: SignatureParameters | None = None,
    *,
    template: Template | None = None,
    watch: progress.Stopwatch | None = None,
) -> ModalSignature:
    """Fit closed-form modes to a sequence.

    Parameters
    ----------
    sequence : MeshSequence
    parameters : SignatureParameters, optional
        7 modes by default: 21 amplitudes a frame.
    template : Template, optional
        The one that the parameters name; made from the sequence's own reference by default.
    watch : Stopwatch, optional
        Told of the stages `template`, `fit` and `notes`.

    Returns
    -------
    ModalSignature

    Raises
    ------
    TopologyError
        If the stated topology does not fit the surface.
    ModeCountError
        If it cannot tell that many modes apart.
    ToleranceError
        If no number of modes keeps the tolerance.
    ParameterError
        If there is no such reference frame, or a tolerance in mm meets an unknown unit.

    Notes
    -----
    Nastar, Vibration modes for nonrigid motion analysis in 3D images, INRIA 1994.
    """
    parameters = resolve_parameters(sequence, parameters or SignatureParameters())
    original, sequence = sequence, resolve_sequence(sequence, parameters)
    watch = watch or progress.Stopwatch()
    with watch.stage("template") as report:
        own_template = resolve_template(sequence, parameters, template, report)
    notes = [*_notes_on_sequence(sequence, parameters.reference), *own_template.notes]
    with watch.stage("fit"):
        fitter, choice = Fitter.of(sequence, own_template, parameters), None
        if parameters.modes is None:
            fit, choice, said = choose_fit(fitter)
            notes += said
        else:
            chosen, words = choose_modes(own_template, parameters.modes, sequence.grid)
            fit = fitter.fit(make_basis(own_template, chosen))
            if parameters.harmonics is not None:
                fit = limited(fitter, fit)
            notes += words
            if len(chosen) > USUAL_MODES:
                notes += notes_on_compactness(len(chosen), sequence.n_vertices)
    modes = fit.basis.modes
    undetermined = np.flatnonzero(~fit.rotations.is_determined)
    if undetermined.size:
        notes.append(
            Note.of(
                "rotation_undetermined",
                frames=counted(undetermined.size, "frame"),
                first=undetermined[0],
            )
        )
    deviations, noise = None, None if choice is None else choice.noise
    with watch.stage("notes"):
        notes += _notes_on_strays(sequence, own_template, fit)
        if parameters.deviations or noise is not None or sequence.uncertainty is not None:
            deviations, said = deviations_of(fitter, fit, noise)
            notes += said
    if parameters.template is not None:
        notes += _notes_on_parting(sequence, own_template)
    if not fit.motion.max.any():
        notes.append(Note.of("nothing_moves"))
    return ModalSignature(
        modes=modes.names,
        amplitudes=fit.amplitudes,
        angular_frequencies=frequencies_of(modes, own_template),
        rotations=fit.rotations,
        reference_amplitudes=fit.reference_amplitudes,
        volumes=enclosed_volumes(sequence, own_template) if parameters.volumes else None,
        translations=fit.translations,
        rms_errors=fit.errors.rms,
        weighted_rms_errors=fit.errors.weighted_rms,
        p95_errors=fit.errors.p95,
        max_errors=fit.errors.max,
        motion_rms=fit.motion.rms,
        weighted_motion_rms=fit.motion.weighted_rms,
        times=sequence.times,
        unit=sequence.unit,
        n_vertices=sequence.n_vertices,
        lengths=own_template.lengths,
        landmarks=own_template.landmarks,
        condition=fit.basis.condition,
        parameters=parameters,
        sequence_id=original.id,
        template_id=own_template.id,
        notes=tuple(notes),
        provenance=provenance(),
        choice=choice,
        amplitude_deviations=deviations,
        facts=original.facts,
    )


def resolve_parameters(
    sequence: MeshSequence, parameters: SignatureParameters
) -> SignatureParameters:
    """Return the parameters with those of the sequence's facts that the fit reads."""
    return parameters.with_facts(sequence.facts, sequence.topology, sequence.grid)


def resolve_sequence(sequence: MeshSequence, parameters: SignatureParameters) -> MeshSequence:
    """Return the sequence with the topology that the parameters state over its own."""
    stated = parameters.topology
    topology = None if stated is None or not parameters.closed_form else Topology.parse(stated)
    return sequence.with_topology(topology, None)


def resolve_template(
    sequence: MeshSequence,
    parameters: SignatureParameters,
    template: Template | None = None,
    report: progress.Reporter = progress.silent,
) -> Template:
    """Give the template that the parameters ask for: the one they name, or the sequence's own.

    The sequence's facts are not read; `resolve_parameters` has done that before. `report` is told
    the share that is done.

    Raises
    ------
    ParameterError
        If they name another template, or one without `template`.
    TopologyError, ConnectivityError
        If the template is of another mesh.
    """
    if parameters.template is not None or template is not None:
        if template is None or template.id != parameters.template:
            raise errors.ParameterError(
                f"The parameters name the template {str(parameters.template)[:12]}, but "
                f"{'none' if template is None else template.id[:12]} came.",
                remedy="Give the template named in the parameters.",
            )
        require_same_mesh(template, sequence)
        return template
    return make_template(
        replace(sequence, facts=mesh.NO_FACTS),
        reference=parameters.reference,
        landmarks=parameters.landmarks,
        closed_form=parameters.closed_form,
        by_rows=parameters.kind != SignatureKind.NORMAL_DISPLACEMENT,
        report=report,
    )


def provenance() -> dict[str, str]:
    """Versions of everything that takes part in a result."""
    return {**_versions(), "python": platform.python_version()}


@lru_cache(maxsize=1)
def _versions() -> dict[str, str]:
    # Each is read from a file of the installation: 6 ms for all, more than the fit itself.
    return {name: version(name) for name in ("modalmotion", "numpy", "scipy", "h5py")}


def _notes_on_parting(sequence: MeshSequence, template: Template) -> list[Note]:
    """Name vertices that are one on a template of another sequence, and lie apart in this one."""
    first = template.representatives
    merged = np.flatnonzero(first != np.arange(len(first)))
    x = sequence.vertices
    apart = merged[(x[:, merged] != x[:, first[merged]]).any(axis=(0, 2))]
    if not len(apart):
        return []
    vertices, other = counted(len(apart), "vertex", "vertices"), first[apart[0]]
    return [Note.of("merged_vertices_apart", vertices=vertices, first=apart[0], other=other)]


def _notes_on_sequence(sequence: MeshSequence, reference: Reference) -> list[Note]:
    notes = []
    if sequence.n_frames == 1:
        notes.append(Note.of("one_frame"))
    if sequence.unit is None:
        notes.append(Note.of("unit_unknown"))
    if sequence.vertices.dtype == np.float32:
        # Direction by direction: along the memory, extremes are ten times as fast.
        x = np.ascontiguousarray(alignment.reference_positions(sequence, reference).T)
        low, high = x.min(axis=1), x.max(axis=1)
        extent = float((high - low).max())
        step = float(np.spacing(np.float32(max(-low.min(), high.max()))))
        if extent > 0 and step > 1e-5 * extent:
            notes.append(Note.of("stored_rounded", step=step))
    return notes


# A largest error is checked beyond so many p95 errors, or this share of the surface.
_P95S: Final = 8.0
_SHARE: Final = 0.2

# Edges of a stray vertex are longer by at least this share of the error; half of the edges of a
# frame that is numbered otherwise are longer, or shorter, by this factor.
_OF_ERROR: Final = 0.5
_FACTOR: Final = 3.0


def _notes_on_strays(sequence: MeshSequence, template: Template, fit: Fit) -> list[Note]:
    """Name the frame with the largest error, and its vertex, if they are out of place.

    Costs nothing where the errors are those of a surface that moves.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
        Its vertices are the reference.
    fit : Fit
        Of the sequence.

    Returns
    -------
    list of Note
        Empty, or one note.
    """
    start, unit = template.vertices, sequence.unit or "length units"
    # Direction by direction, which is ten times as fast as all at once.
    extent = max(float(np.ptp(x)) for x in start.T)
    largest = fit.errors.max
    frame, error = int(largest.argmax()), float(largest.max())
    farthest = int(fit.motion.weighted_rms.argmax())
    suspects = []
    if fit.motion.weighted_rms[farthest] > _SHARE * extent:
        suspects.append(farthest)
    if error > min(_P95S * float(fit.errors.p95[frame]), _SHARE * extent):
        suspects.append(frame)
    if not suspects or not extent > 0:
        return []
    sides = edges_of(template)
    before = _lengths(start, sides, extent)
    usual = float(np.median(before))
    for suspect in suspects:
        after = _lengths(sequence.vertices[suspect].astype(np.float64), sides, extent)
        length = float(np.median(after))
        if not usual / _FACTOR <= length <= usual * _FACTOR:
            ratio = length / usual if usual > 0 else np.inf
            return [Note.of("frame_unlike", frame=suspect, ratio=ratio)]
    growth = np.full(len(start), np.inf)
    np.minimum.at(growth, sides.ravel(), np.repeat(after - before, 2))
    growth[np.isinf(growth)] = 0.0
    strays = np.flatnonzero(growth > _OF_ERROR * error / extent)
    if frame not in suspects or not len(strays):
        return []
    vertex = int(growth.argmax())
    more = "" if len(strays) == 1 else f" ({len(strays)} such vertices in this frame)"
    note = Note.of(
        "vertex_astray",
        frame=frame,
        vertex=vertex,
        distance=numeral(float(growth[vertex]) * extent),
        unit=unit,
        more=more,
    )
    return [note]


def _lengths(vertices: Floats, sides: Ints, extent: float) -> Floats:
    """Lengths of sides over the extent, whose squares are ordinary numbers in any unit."""
    along = (vertices[sides[:, 1]] - vertices[sides[:, 0]]) / extent
    return np.asarray(np.linalg.norm(along, axis=1))
