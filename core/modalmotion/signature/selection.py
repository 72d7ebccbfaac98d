"""Selection of the modes: the requested number, or as few as serve."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ToleranceError
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.numeric.products import lengths, product
from modalmotion.representation import counted
from modalmotion.signature.basis import Basis, TemplateCache, make_basis
from modalmotion.signature.fit import Fit
from modalmotion.signature.fitter import NUMBERS, Fitter, Scene, SceneKind, scene_of
from modalmotion.signature.model import (
    COMPACT,
    Harmonics,
    Model,
    ModelChoice,
    error_of,
    fit_model,
    harmonics_of,
    holds_noise,
    limit_of,
    note_on_compactness,
    require_harmonics,
    require_unit,
    simplest,
    simplest_with_noise,
    static_model,
)
from modalmotion.signature.nested_modes import (
    Energies,
    Ladder,
    energies_of,
    ladder_of,
    plain_energies_of,
)
from modalmotion.signature.noise import modes_until_noise, with_ladder
from modalmotion.signature.parameters import (
    MOST_MODES,
    ErrorKind,
    SignatureKind,
    SignatureParameters,
)
from modalmotion.template import choose_modes
from modalmotion.template.body_frame import Components


def largest_errors(
    fitter: Fitter, ladder: Ladder, energies: Energies, counts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Largest error of any vertex in any frame for each of several nested sets.

    Unlike the RMS error it may grow with the set, so none can be left out. Each set's
    residual is that of the one before without its further modes.

    Parameters
    ----------
    fitter : Fitter
    ladder : Ladder
    energies : Energies
        Their coefficients may have been limited to harmonics.
    counts : (sets,) int64
        Increasing.

    Returns
    -------
    (sets,) float64, length unit
    """
    basis, last = ladder.basis, int(counts[-1])
    # u = sum_j c_j psi_j
    psi = basis.orthonormal_rows(last)
    largest = np.zeros(len(counts))
    for block in fitter.displacements.blocks():
        scale = block.shape.scale
        u, loose_u = fitter.in_components(block)
        loose_psi = np.ascontiguousarray(psi[:, block.loose].T)
        f, n_directions, n = u.shape
        c = energies.coefficients[block.frames] * (energies.scale / scale)
        rows = u.reshape(n_directions * f, n)
        flat = np.ascontiguousarray(c.transpose(0, 2, 1)).reshape(n_directions * f, -1)
        done = 0
        for k, count in enumerate(counts.tolist()):
            rows -= product(np.ascontiguousarray(flat[:, done:count]), psi[done:count])
            loose_u = loose_u - loose_psi[:, done:count] @ (
                energies.coefficients[block.frames, done:count] * energies.scale
            )
            done = count
            squares = (rows.reshape(f, n_directions, n) ** 2).sum(axis=1)
            squares[:, block.shape.ignored] = 0.0
            largest[k] = max(
                largest[k],
                scale * float(np.sqrt(squares.max())),
                float(lengths(loose_u).max(initial=0.0)),
            )
    return largest


# Errors of nested sets are known to this share, and to this share of the motion.
_ROUNDING: Final = 1e-9
_ROUNDING_OF_MOTION: Final = 1e-12


@dataclass(frozen=True, eq=False)
class SetErrors:
    """Errors of the sets of one ladder, of the requested kind.

    Parameters
    ----------
    fitter : Fitter
    ladder : Ladder
    energies : Energies
        Plain ones for the RMS over all vertices, by weight for any other kind.
    """

    fitter: Fitter
    ladder: Ladder
    energies: Energies

    @staticmethod
    def on(fitter: Fitter, ladder: Ladder, fit: Fit) -> SetErrors:
        """Measure the sets of a ladder whose largest is fitted."""
        is_plain = fitter.parameters.tolerance_of == ErrorKind.RMS
        if is_plain:
            return SetErrors(fitter, ladder, plain_energies_of(fitter, ladder.basis, fit))
        return SetErrors(fitter, ladder, energies_of(ladder.basis, fit))

    def slack(self, limit: float) -> float:
        """Bound the rounding of errors computed from energies."""
        return _ROUNDING * limit + _ROUNDING_OF_MOTION * self.energies.scale

    def bound(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """RMS errors: the requested ones, or a lower bound of the largest."""
        if self.fitter.parameters.harmonics is not None:
            return self._joint(counts)
        if self.fitter.parameters.tolerance_of == ErrorKind.MAX:
            return self.energies.worst_frame_rms(counts)
        return self.energies.rms(counts)

    def of(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """Errors of sets that increase in number."""
        if self.fitter.parameters.tolerance_of != ErrorKind.MAX:
            return self.bound(counts)
        limited = self.energies
        if self.fitter.parameters.harmonics is not None:
            functions = self._functions
            paths = functions.limited(limited.coefficients, self.fitter.parameters.harmonics)
            limited = replace(limited, coefficients=paths)
        return largest_errors(self.fitter, self.ladder, limited, counts)

    def best(self, known: dict[int, float]) -> tuple[float, int]:
        """Smallest error of all sets, and its number of modes."""
        counts = self.ladder.counts
        bounds = self.bound(counts)
        first = counts[[int(np.argmin(bounds))]]
        tried = {**known, int(first[0]): float(self.of(first)[0])}
        # No set is better than its bound: those that may be are measured together.
        others = counts[bounds < min(tried.values())]
        if self.fitter.parameters.tolerance_of == ErrorKind.MAX and len(others):
            tried.update(zip(others.tolist(), self.of(others).tolist(), strict=True))
        return min((error, count) for count, error in tried.items())

    @property
    def _functions(self) -> Harmonics:
        return harmonics_of(self.fitter.sequence.n_frames, self.fitter.sequence.times)

    def _joint(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        functions = self._functions
        harmonics = self.fitter.parameters.harmonics or 0
        require_harmonics(harmonics, functions)
        return self.energies.joint_rms(counts, functions)[:, harmonics]


# The first ladder; each further one is twice as long.
_FIRST: Final = 64

# Sets that are scanned for their largest error before one is tried.
_WINDOW: Final = 16


def smallest_within(fitter: Fitter, limit: float) -> Model:
    """Smallest whole set whose error, as measured on its own fit, holds a limit.

    Raises
    ------
    ToleranceError
        If none does; its details name the best error possible.
    """
    parameters = fitter.parameters
    n = _FIRST
    known: dict[int, float] = {}
    while True:
        ladder = ladder_of(fitter.template, n, fitter.sequence.grid)
        fit = fitter.fit(ladder.basis)
        errors = SetErrors.on(fitter, ladder, fit)
        counts = ladder.counts[ladder.counts > max(known, default=0)]
        # No maximum is below the RMS of its frame.
        counts = counts[errors.bound(counts) <= limit + errors.slack(limit)]
        for first in range(0, len(counts), _WINDOW):
            some = counts[first : first + _WINDOW]
            known.update(zip(some.tolist(), errors.of(some).tolist(), strict=True))
            for count in some.tolist():
                if known[count] <= limit + errors.slack(limit):
                    model = fit_model(fitter, make_basis(fitter.template, ladder.modes(count)))
                    if model.error(parameters.tolerance_of) <= limit:
                        notes = (*ladder.notes, *_on_set(errors, count))
                        return replace(model, notes=notes)
        if ladder.ends_because or n >= MOST_MODES:
            best = errors.best(known)
            raise _unreachable(fitter, limit, best, ladder)
        known.setdefault(int(ladder.counts[-1]), np.inf)
        n = min(2 * n, MOST_MODES)


def _on_set(errors: SetErrors, count: int) -> tuple[str, ...]:
    """Say that a set is no longer compact, and the tolerance at which one is."""
    sequence, counts = errors.fitter.sequence, errors.ladder.counts
    note = note_on_compactness(count, sequence.n_vertices)
    compact = counts[counts * COMPACT <= sequence.n_vertices]
    if not note or not len(compact):
        return note
    error = float(errors.of(compact[-1:])[0])
    unit = sequence.unit or "length units"
    text = (
        f"{note[0]} {counted(int(compact[-1]), 'mode')} leave {error * (1 + 1e-6):.7g} {unit}: "
        "ask for that tolerance, or keep the sequence itself as a stream (encode)."
    )
    return (text,)


def _unreachable(
    fitter: Fitter, limit: float, best: tuple[float, int], ladder: Ladder
) -> ToleranceError:
    """Error that names the tolerance to allow, in mm.

    Parameters
    ----------
    fitter : Fitter
    limit : float, length unit
    best : (float, int)
        Smallest error, length unit, and its number of modes.
    ladder : Ladder
        All that were tried.
    """
    parameters, unit = fitter.parameters, fitter.sequence.unit or "length units"
    error, count = best
    in_mm = MM_PER_UNIT.get(unit)
    reason = ladder.ends_because or f"a signature has at most {MOST_MODES}"
    return ToleranceError(
        f"No set of modes holds {limit:.6g} {unit} ({parameters.tolerance_of}): the best, of "
        f"{count} modes, leaves {error:.6g} {unit}; {reason}.",
        remedy=f"Allow a tolerance of {error * (in_mm or 1.0) * (1 + 1e-6):.7g} mm or more.",
        details={
            "limit_asked": limit,
            "best_error": error,
            "best_error_mm": None if in_mm is None else error * in_mm,
            "best_modes": count,
            "error_of": parameters.tolerance_of.value,
            "unit": fitter.sequence.unit,
        },
    )


def select_model(fitter: Fitter, cache: TemplateCache) -> Model:
    """Fit the model that parameters ask for.

    Parameters
    ----------
    fitter : Fitter
    cache : TemplateCache
        Holds factored modes for a stated number.

    Raises
    ------
    ToleranceError
        If no set of modes holds the tolerance; its details name the best error possible.
    ParameterError
        If a tolerance is in mm and the unit unknown, or an option does not go with the data.
    ModeCountError
        If the surface cannot tell that many modes apart.
    """
    sequence, template, parameters = fitter.sequence, fitter.template, fitter.parameters
    if not parameters.is_adaptive:
        return _with_count(fitter, cache)
    require_unit(parameters, sequence)
    smallest = make_basis(template, choose_modes(template, 1, sequence.grid).modes)
    first = fit_model(fitter.asking(harmonics=None), smallest)
    scene = scene_of(fitter, first.fit.rotations)
    if parameters.auto:
        return _until_noise(fitter, smallest, scene)
    limit = limit_of(parameters, sequence)
    kind, errors = simplest(scene, limit, parameters.tolerance_of), scene.errors
    if parameters.kind == SignatureKind.OFFSET and kind != SceneKind.STATIC:
        # The other kinds are of displacements.
        kind, errors = SceneKind.DEFORMABLE, {SceneKind.STATIC: scene.static.error}
    choice = ModelChoice("tolerance", limit, parameters.tolerance_of, None, kind, errors, None)
    if kind == SceneKind.STATIC:
        model = static_model(fitter, smallest, scene.static)
        return _noted(model, choice, sequence)
    model = smallest_within(fitter, limit)
    off_plane = error_of(scene.planar.error, parameters.tolerance_of)
    if _may_flatten(parameters) and off_plane <= limit:
        normal = scene.planar.normal
        flat = fit_model(fitter, model.basis, normal=normal)
        if flat.error(parameters.tolerance_of) <= limit:
            model = replace(flat, notes=model.notes)
            choice = replace(choice, normal=normal)
    return _noted(model, choice, sequence)


def _with_count(fitter: Fitter, cache: TemplateCache) -> Model:
    parameters = fitter.parameters
    choice, basis = cache.basis(
        fitter.template,
        parameters.modes or 1,
        fitter.sequence.grid,
        split_pairs=parameters.split_pairs,
    )
    model = fit_model(fitter, basis)
    return replace(model, notes=(*choice.notes, *_on_size(model, fitter.sequence)))


def _until_noise(fitter: Fitter, smallest: Basis, scene: Scene) -> Model:
    sequence, parameters = fitter.sequence, fitter.parameters
    noise, found = with_ladder(fitter)
    kind = simplest_with_noise(scene, noise, fitter)
    limit = noise.displacement_rms(sequence.n_frames, parameters.reference)
    choice = ModelChoice("auto", limit, ErrorKind.WEIGHTED_RMS, noise, kind, scene.errors, None)
    if kind == SceneKind.STATIC:
        model = static_model(fitter, smallest, scene.static)
        return _noted(model, choice, sequence)
    is_simple = kind == SceneKind.RIGID and parameters.remove_rotation
    if is_simple and parameters.components == Components.CARTESIAN:
        return _noted(fit_model(fitter, smallest), choice, sequence)
    ladder, count = modes_until_noise(fitter, noise, found)
    normal = None
    if _may_flatten(parameters) and holds_noise(scene.planar.error.weighted_rms, noise, fitter, 1):
        normal = scene.planar.normal
    model = fit_model(fitter, ladder.basis_of(count), normal=normal)
    notes = [*ladder.notes, *_on_size(model, sequence)]
    if count == ladder.counts[-1]:
        reason = ladder.ends_because or f"a signature has at most {MOST_MODES} modes"
        notes.append(
            f"The residual of {count} modes still shows motion above the noise, but {reason}."
        )
    choice = replace(choice, normal=normal)
    return _noted(replace(model, notes=tuple(notes)), choice, sequence)


def _on_size(model: Model, sequence: MeshSequence) -> tuple[str, ...]:
    notes = note_on_compactness(len(model.modes), sequence.n_vertices)
    most = max(sequence.n_vertices // COMPACT, 1)
    return tuple(f"{note} Ask for at most {counted(most, 'mode')}." for note in notes)


def _may_flatten(parameters: SignatureParameters) -> bool:
    is_material = parameters.kind == SignatureKind.MATERIAL
    is_cartesian = parameters.components == Components.CARTESIAN
    return is_material and is_cartesian and parameters.remove_rotation


def _noted(model: Model, choice: ModelChoice, sequence: MeshSequence) -> Model:
    unit = sequence.unit or "length units"
    notes = list(model.notes)
    if choice.noise is not None:
        notes.append(choice.noise.note(sequence.unit))
    kind, n = choice.scene, model.fit.amplitudes[0].size
    if kind != SceneKind.DEFORMABLE:
        error = choice.errors[kind].rms
        text = f"The scene is {kind}: "
        if kind == SceneKind.PLANAR:
            text += f"leaving out what is off a plane leaves {error:.3g} {unit} RMS."
        else:
            text += f"{NUMBERS[kind]} numbers a frame leave {error:.3g} {unit} RMS."
        if kind == SceneKind.AFFINE and n > NUMBERS[kind]:
            text += f" As modes it takes {n} amplitudes."
        notes.append(text)
    if choice.normal is not None:
        notes.append("The amplitudes were limited to a plane: two numbers for each mode.")
    return replace(model, choice=choice, notes=tuple(notes))
