"""As few modes as a tolerance or the noise asks for, and simple scenes: static, rigid, affine."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Final

import numpy as np

from modalmotion.errors import ParameterError, ToleranceError
from modalmotion.mesh.alignment import Rotations
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.notes import Note
from modalmotion.representation import Floats, counted, shown
from modalmotion.signature.fit import Fit, Fitter, FrameErrors, errors_of, make_basis
from modalmotion.signature.nested_modes import (
    NestedModes,
    energies_of,
    largest_errors,
    limited,
    nested_modes,
    required_harmonics,
)
from modalmotion.signature.noise import Found, Noise, estimated, modes_until_noise
from modalmotion.signature.parameters import MOST_MODES, USUAL_MODES, ErrorKind, SignatureParameters
from modalmotion.template import choose_modes


class SceneKind(StrEnum):
    """Kinds of motion, the ones that need fewest numbers first."""

    STATIC = "static"
    RIGID = "rigid"
    AFFINE = "affine"
    DEFORMABLE = "deformable"


NUMBERS: Final = {SceneKind.STATIC: 0, SceneKind.RIGID: 6, SceneKind.AFFINE: 12}
"""Numbers a frame that describe a motion of each kind."""

# A reference that is flat to this share of its size has no affine motion off its plane.
_FLAT: Final = 1e-12


@dataclass(frozen=True)
class SceneError:
    """Error of a description of all of a motion.

    Parameters
    ----------
    rms, weighted_rms, p95, max : float, length unit
        RMS over all vertices and frames; that by the vertices' shares of the surface; the
        largest 95th percentile of any frame; the largest of any vertex in any frame.
    """

    rms: float
    weighted_rms: float
    p95: float
    max: float

    @staticmethod
    def of(errors: FrameErrors) -> "SceneError":
        """Put the errors of all frames together."""
        rms, weighted, most = map(
            errors.over_frames, (ErrorKind.RMS, ErrorKind.WEIGHTED_RMS, ErrorKind.MAX)
        )
        return SceneError(rms, weighted, float(errors.p95.max()), most)


def simple_motions(fitter: Fitter, fit: Fit) -> dict[SceneKind, FrameErrors]:
    """Measure a sequence against each simple kind of motion; normal displacements against rest.

    Static is the reference itself; rigid and affine motions are A (x - c) + c + t of its positions
    x and its centroid c, A a rotation or any matrix.

    Parameters
    ----------
    fitter : Fitter
    fit : Fit
        Of any modes, whose rotations are taken.
    """
    if fitter.normal_displacements is not None:
        return {SceneKind.STATIC: fit.motion}
    shape = fitter.displacements.shape
    moments = shape.moments[:, :3].T @ shape.rest.T
    inverse = np.linalg.pinv(moments, rcond=_FLAT, hermitian=True)
    squares: dict[SceneKind, list[Floats]] = {kind: [] for kind in NUMBERS}
    for block in fitter.displacements.positions():
        sums = block.positions @ shape.moments
        drifts = sums[:, :, 3:]
        # Nothing is known of directions that the reference lacks.
        affine = np.eye(3) + (sums[:, :, :3] - moments) @ inverse
        models = (
            (np.eye(3)[None], 0.0 * drifts),
            (fit.rotations.matrices[block.frames], drifts),
            (affine, drifts),
        )
        for kind, (A, t) in zip(NUMBERS, models, strict=True):
            left = block.positions - A @ shape.rest - t
            squares[kind].append((left**2).sum(axis=1))
    return {kind: errors_of(parts, fitter.template, shape.scale) for kind, parts in squares.items()}


COMPACT: Final = 10
"""Coordinates for each amplitude of a frame, from which a signature is called compact."""


def notes_on_compactness(n_modes: int, n_vertices: int) -> list[Note]:
    """Return a note if so many modes are no longer compact and more than the usual number."""
    if n_modes <= USUAL_MODES or n_modes * COMPACT <= n_vertices:
        return []
    return [
        Note.of(
            "not_compact",
            n_modes=n_modes,
            n_vertices=n_vertices,
            ratio=n_vertices / n_modes,
            most=counted(max(n_vertices // COMPACT, 1), "mode"),
        )
    ]


@shown("asked", "limit", "limit_of", "scene", "noise.sigma")
@dataclass(frozen=True)
class ModelChoice:
    """Reason for the modes of a signature.

    Parameters
    ----------
    asked : str
        "tolerance" or "auto".
    limit : float, length unit
        The error limit; for "auto" the weighted RMS error that noise alone would leave.
    limit_of : ErrorKind
    noise : Noise or None
        The estimate, for "auto".
    scene : SceneKind
        The simplest kind of motion that holds the limit.
    errors : dict of SceneKind to SceneError
        Error of each kind.
    """

    asked: str
    limit: float
    limit_of: ErrorKind
    noise: Noise | None
    scene: SceneKind
    errors: dict[SceneKind, SceneError]

    @staticmethod
    def from_json(values: dict[str, Any]) -> "ModelChoice":
        """Read what `plain` gives of it."""
        noise = values["noise"]
        own = {
            "limit_of": ErrorKind(values["limit_of"]),
            "noise": noise and Noise(**noise),
            "scene": SceneKind(values["scene"]),
            "errors": {SceneKind(k): SceneError(**e) for k, e in values["errors"].items()},
        }
        return ModelChoice(**{**values, **own})

    def notes(self, fit: Fit, unit: str | None) -> list[Note]:
        """Describe what the choice rests on."""
        notes = [] if self.noise is None else [self.noise.note(unit)]
        if self.scene != SceneKind.DEFORMABLE:
            size, numbers = fit.amplitudes[0].size, NUMBERS[self.scene]
            is_more = self.scene == SceneKind.AFFINE and size > numbers
            notes.append(
                Note.of(
                    "scene",
                    scene=self.scene.value,
                    numbers=numbers,
                    rms=self.errors[self.scene].rms,
                    unit=unit or "length units",
                    modes=f" As modes, that is {size} amplitudes." if is_more else "",
                )
            )
        return notes


def choose_fit(fitter: Fitter) -> tuple[Fit, ModelChoice, list[Note]]:
    """Fit as few modes as the parameters' tolerance, or the noise, asks for.

    Returns
    -------
    fit : Fit
    choice : ModelChoice
    notes : list of Note

    Raises
    ------
    ToleranceError
        If no set of modes keeps the tolerance; its details name the best error possible.
    ParameterError
        If a tolerance is in mm and the unit unknown, or an option does not go with the data.
    """
    sequence, template, parameters = fitter.sequence, fitter.template, fitter.parameters
    lowest = choose_modes(template, 1, sequence.grid)[0]
    smallest = fitter.fit(make_basis(template, lowest))
    motions = simple_motions(fitter, smallest)
    errors = {kind: SceneError.of(motion) for kind, motion in motions.items()}
    found: Found | None = None
    if parameters.auto:
        found, of = estimated(fitter), ErrorKind.WEIGHTED_RMS
        limit = found.noise.displacement_rms(sequence.n_frames, parameters.reference)
        bound = limit * found.noise.excess
    else:
        limit, of = limit_of(parameters, sequence), parameters.tolerance_of
        bound = limit
    holding = (kind for kind in errors if getattr(errors[kind], of.value) <= bound)
    kind = next(holding, SceneKind.DEFORMABLE)
    noise = None if found is None else found.noise
    choice = ModelChoice("auto" if found else "tolerance", limit, of, noise, kind, errors)
    notes: list[Note] = []
    if kind == SceneKind.STATIC:
        fit = replace(
            smallest,
            amplitudes=np.zeros_like(smallest.amplitudes),
            rotations=Rotations.none(sequence.n_frames),
            translations=np.zeros_like(smallest.translations),
            errors=motions[kind],
        )
    elif found is None:
        fit, notes = _smallest_within(fitter, limit)
    elif kind == SceneKind.RIGID and fitter.frames is None and parameters.remove_rotation:
        fit = limited(fitter, smallest)
    else:
        nested, count = modes_until_noise(fitter, found)
        fit = limited(fitter, fitter.fit(nested.basis.first(count)))
        notes = [*nested.notes, *notes_on_compactness(count, sequence.n_vertices)]
        if count == nested.counts[-1]:
            reason = nested.ends_because or f"a signature has at most {MOST_MODES} modes"
            notes.append(Note.of("motion_left", n_modes=count, reason=reason))
    return fit, choice, [*notes, *choice.notes(fit, sequence.unit)]


def limit_of(parameters: SignatureParameters, sequence: MeshSequence) -> float:
    """Error that parameters with a tolerance allow, in the length unit of the sequence.

    Raises
    ------
    ParameterError
        If the tolerance is in mm and the unit of the sequence is unknown.
    """
    if sequence.unit is None:
        raise ParameterError(
            f"A tolerance of {parameters.tolerance:g} mm was requested, but the length unit of the "
            "sequence is unknown.",
            remedy="Set the unit: m, cm, mm, um or nm.",
        )
    return (parameters.tolerance or 0.0) / MM_PER_UNIT[sequence.unit]


# Errors of nested sets are known to this share, and to this share of the motion.
_ROUNDING: Final = 1e-9
_ROUNDING_OF_MOTION: Final = 1e-12

# Modes of the first nested sets; each further ones are twice as many.
_FIRST: Final = 64


def _smallest_within(fitter: Fitter, limit: float) -> tuple[Fit, list[Note]]:
    """Smallest whole set whose error, as measured on its own fit, holds a limit."""
    sequence, kind = fitter.sequence, fitter.parameters.tolerance_of
    n, best = _FIRST, (np.inf, 0)
    while True:
        nested = nested_modes(fitter.template, n, sequence.grid)
        errors, slack = _errors_of(fitter, nested)
        for k in np.flatnonzero(errors <= limit + _ROUNDING * limit + slack).tolist():
            basis = make_basis(fitter.template, nested.basis.first(int(nested.counts[k])).modes)
            fit = limited(fitter, fitter.fit(basis))
            if fit.errors.over_frames(kind) <= limit:
                n_modes = len(basis.modes)
                return fit, [*nested.notes, *notes_on_compactness(n_modes, sequence.n_vertices)]
        least = int(np.argmin(errors))
        best = min(best, (float(errors[least]), int(nested.counts[least])))
        if nested.ends_because or n >= MOST_MODES:
            raise _unreachable(fitter, limit, best, nested)
        n = min(2 * n, MOST_MODES)


def _errors_of(fitter: Fitter, nested: NestedModes) -> tuple[Floats, float]:
    """Error of each set, of the kind that the tolerance limits, and its rounding."""
    parameters, counts = fitter.parameters, nested.counts
    energies = energies_of(fitter, fitter.fit(nested.basis), parameters.tolerance_of)
    slack, harmonics = _ROUNDING_OF_MOTION * energies.scale, parameters.harmonics
    if parameters.tolerance_of == ErrorKind.MAX:
        if harmonics is not None:
            paths = required_harmonics(fitter).limited(energies.coefficients, harmonics)
            energies = replace(energies, coefficients=paths)
        return largest_errors(fitter, nested.basis, energies, counts), slack
    if harmonics is None:
        return energies.rms(counts), slack
    return energies.joint_rms(counts, required_harmonics(fitter))[:, harmonics], slack


def _unreachable(
    fitter: Fitter, limit: float, best: tuple[float, int], nested: NestedModes
) -> ToleranceError:
    """Error that names the tolerance to allow, in mm."""
    kind, unit, (error, count) = fitter.parameters.tolerance_of, fitter.sequence.unit or "", best
    allowed = error * MM_PER_UNIT[unit]
    reason = nested.ends_because or f"a signature has at most {MOST_MODES}"
    return ToleranceError(
        f"No set of modes meets {limit:.6g} {unit} ({kind}): the best, with {count} modes, has an "
        f"error of {error:.6g} {unit}; {reason}.",
        remedy=f"Allow a tolerance of {allowed * (1 + 1e-6):.7g} mm or more.",
        details={
            "limit_asked": limit,
            "best_error": error,
            "best_error_mm": allowed,
            "best_modes": count,
            "error_of": kind.value,
            "unit": unit,
        },
    )
