"""The model that answers a request: the requested number of modes, or as few as serve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from modalmotion.choice.fitted_motion import Model, fit_model, static_model
from modalmotion.choice.fitter import Fitter
from modalmotion.choice.limit import (
    error_of,
    holds_noise,
    limit_of,
    require_unit,
    simplest,
    simplest_with_noise,
)
from modalmotion.choice.noise_level import modes_until_noise, with_ladder
from modalmotion.choice.ordered_sets import ENERGY_POOL, notes_on, sorted_ladder
from modalmotion.choice.parameters import ErrorKind, ModeOrder, SignatureKind, SignatureParameters
from modalmotion.choice.reason import COMPACT, ModelChoice, note_on_compactness
from modalmotion.choice.scene import NUMBERS, Scene, SceneKind, scene_of
from modalmotion.choice.smallest_set import smallest_within
from modalmotion.errors import ModeCountError
from modalmotion.fit.basis import Basis, make_basis
from modalmotion.fit.cache import TemplateCache
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numerals import counted
from modalmotion.template import choose_modes
from modalmotion.template.body_frame import Components


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
    limit = limit_of(parameters, sequence, first.fit)
    kind, errors = simplest(scene, limit, parameters.tolerance_of), scene.errors
    if parameters.kind == SignatureKind.OFFSET and kind != SceneKind.STATIC:
        # The other kinds are of displacements.
        kind, errors = SceneKind.DEFORMABLE, {SceneKind.STATIC: scene.static.error}
    way = "tolerance" if parameters.tolerance is not None else "tolerance_share"
    choice = ModelChoice(way, limit, parameters.tolerance_of, None, kind, errors, None)
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
    n = parameters.modes or 1
    if parameters.order == ModeOrder.FIXED:
        choice, basis = cache.basis(
            fitter.template, n, fitter.sequence.grid, split_pairs=parameters.split_pairs
        )
        model = fit_model(fitter, basis)
        return replace(model, notes=(*choice.notes, *_on_size(model, fitter.sequence)))
    ladder, _ = sorted_ladder(fitter, parameters.most_modes or max(ENERGY_POOL, n))
    if n > ladder.counts[-1]:
        raise ModeCountError(
            f"{n} modes were requested among the {ladder.counts[-1]} whose energy is compared.",
            remedy=f"Ask for at most {ladder.counts[-1]} modes, or "
            f"{'send a finer mesh' if ladder.ends_because else 'for a larger most_modes'}.",
            details={"modes": n, "most": int(ladder.counts[-1])},
        )
    count = int(ladder.counts[np.searchsorted(ladder.counts, n)])
    model = fit_model(fitter, make_basis(fitter.template, ladder.modes(count)))
    notes = (*notes_on(ladder, parameters), *_on_size(model, fitter.sequence))
    return replace(model, notes=notes)


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
    notes = [*notes_on(ladder, parameters), *_on_size(model, sequence)]
    if count == ladder.counts[-1]:
        reason = ladder.ends_because or "no more were allowed"
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
