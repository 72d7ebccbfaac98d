"""The model that answers a request: as many modes as were asked for, or as few as serve."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.body_frame import Components
from modalmotion.choice.energies import Energies, energies_of
from modalmotion.choice.energy_order import by_energy
from modalmotion.choice.harmonics import harmonics_of, require_harmonics
from modalmotion.choice.ladder import Ladder, ladder_of
from modalmotion.choice.largest_errors import largest_errors
from modalmotion.choice.limit import (
    holds_noise,
    limit_of,
    noise_rms,
    require_unit,
    simplest,
    simplest_with_noise,
)
from modalmotion.choice.model import Model, fit_model, fit_with, static_model
from modalmotion.choice.model_choice import ModelChoice
from modalmotion.choice.noise import Noise, estimate_noise
from modalmotion.choice.scene import NUMBERS, Scene, SceneKind, scene_of
from modalmotion.errors import ModeCountError, ToleranceError
from modalmotion.fit import Fit
from modalmotion.modes import ModeSet
from modalmotion.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.signature_parameters import (
    MOST_MODES,
    ErrorKind,
    ModeOrder,
    SignatureParameters,
)
from modalmotion.spring_modes import SpringModes
from modalmotion.template import Template, choose_modes
from modalmotion.template_cache import TemplateCache

# The first ladder; each further one is twice as long.
_FIRST: Final = 64
_FIRST_FOR_NOISE: Final = 128

ENERGY_POOL: Final = 200
"""Modes among which those with most energy are looked for, unless `most_modes` says."""

# Sets that are scanned for their largest error before it is decided whether one serves.
_WINDOW: Final = 16

# Errors of nested sets are known to this share, and to this share of the motion.
_ROUNDING: Final = 1e-9
_ROUNDING_OF_MOTION: Final = 1e-12


def select_model(
    sequence: MeshSequence, template: Template, asked: SignatureParameters, cache: TemplateCache
) -> Model:
    """Fit the model that parameters ask for.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
    asked : SignatureParameters
    cache : TemplateCache
        Where factored modes of a stated number are looked for, and kept.

    Raises
    ------
    ToleranceError
        If no set of modes holds the tolerance; its details say the best that can be had.
    ParameterError
        If a tolerance is in mm and the unit unknown, or an option does not go with the data.
    ModeCountError
        If the surface cannot tell that many modes apart.
    """
    if not asked.is_adaptive:
        return _with_count(sequence, template, asked, cache)
    require_unit(asked, sequence)
    smallest = choose_modes(template, 1, sequence.grid).modes
    first = fit_model(sequence, template, smallest, replace(asked, harmonics=None))
    scene = scene_of(sequence, template, first.fit.rotations, reference=asked.reference)
    if asked.auto:
        return _until_noise(sequence, template, asked, smallest, scene)
    limit = limit_of(asked, sequence, first.fit.motion_rms)
    kind = simplest(scene, limit, asked.tolerance_of)
    way = "tolerance" if asked.tolerance is not None else "tolerance_share"
    choice = ModelChoice(way, limit, asked.tolerance_of, None, kind, scene.errors, None)
    if kind == SceneKind.STATIC:
        found = static_model(sequence, template, smallest, scene.static, asked)
        return _noted(found, choice, sequence)
    found = _smallest_within(sequence, template, asked, limit)
    if _may_flatten(asked) and simplest_is_planar(scene, limit, asked.tolerance_of):
        normal = scene.planar.normal
        flat = fit_model(sequence, template, found.modes, asked, normal=normal)
        if flat.error(asked.tolerance_of) <= limit:
            found = replace(flat, notes=found.notes)
            choice = replace(choice, normal=normal)
    return _noted(found, choice, sequence)


def simplest_is_planar(scene: Scene, limit: float, kind: ErrorKind) -> bool:
    """Tell whether leaving out what is off the plane holds a limit by itself."""
    error = scene.planar.error
    return (error.max if kind == ErrorKind.MAX else error.rms) <= limit


def _with_count(
    sequence: MeshSequence, template: Template, asked: SignatureParameters, cache: TemplateCache
) -> Model:
    n = asked.modes or 1
    if asked.order == ModeOrder.FIXED:
        choice, basis = cache.basis(template, n, sequence.grid)
        found = fit_model(sequence, template, choice.modes, asked, basis=basis)
        return replace(found, notes=choice.notes)
    ladder, _ = _ladder(sequence, template, asked, asked.most_modes or max(ENERGY_POOL, n))
    if n > ladder.counts[-1]:
        raise ModeCountError(
            f"{n} modes were asked for among the {ladder.counts[-1]} whose energy is compared.",
            remedy=f"Ask for at most {ladder.counts[-1]} modes, or for a larger most_modes.",
            details={"modes": n, "most": int(ladder.counts[-1])},
        )
    count = int(ladder.counts[np.searchsorted(ladder.counts, n)])
    found = fit_model(sequence, template, ladder.modes(count), asked)
    return replace(found, notes=_notes_on(ladder, asked))


def _smallest_within(
    sequence: MeshSequence, template: Template, asked: SignatureParameters, limit: float
) -> Model:
    """Smallest whole set whose error, as measured on its own fit, holds a limit."""
    most = asked.most_modes or MOST_MODES
    n = min(_FIRST, most)
    if asked.order == ModeOrder.ENERGY:
        n = most = asked.most_modes or ENERGY_POOL
    known: dict[int, float] = {}
    while True:
        ladder, fit = _ladder(sequence, template, asked, n)
        errors = _Errors(sequence, template, asked, ladder, energies_of(ladder.basis, fit))
        counts = ladder.counts[ladder.counts > max(known, default=0)]
        # No maximum is below the RMS of its frame.
        counts = counts[errors.bound(counts) <= limit + errors.slack(limit)]
        for first in range(0, len(counts), _WINDOW):
            some = counts[first : first + _WINDOW]
            known.update(zip(some.tolist(), errors.of(some).tolist(), strict=True))
            for count in some.tolist():
                if known[count] <= limit + errors.slack(limit):
                    found = fit_model(sequence, template, ladder.modes(count), asked)
                    if found.error(asked.tolerance_of) <= limit:
                        return replace(found, notes=_notes_on(ladder, asked))
        if ladder.ends_because or n >= most:
            best = errors.best(known)
            reason = ladder.ends_because or f"no more than {ladder.counts[-1]} were allowed"
            raise _unreachable(sequence, asked, limit, best, reason)
        known.setdefault(int(ladder.counts[-1]), np.inf)
        n = min(2 * n, most)


@dataclass(frozen=True, eq=False)
class _Errors:
    """Errors of the sets of one ladder, of the kind that is asked about."""

    sequence: MeshSequence
    template: Template
    asked: SignatureParameters
    ladder: Ladder
    energies: Energies

    def slack(self, limit: float) -> float:
        """How far errors that are worked out from energies may be off."""
        return _ROUNDING * limit + _ROUNDING_OF_MOTION * self.energies.scale

    def bound(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """RMS errors, which are no larger than what is asked about."""
        if self.asked.harmonics is not None:
            return self._joint(counts)
        if self.asked.tolerance_of == ErrorKind.MAX:
            return self.energies.worst_frame_rms(counts)
        return self.energies.rms(counts)

    def of(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """Errors of sets that increase in number."""
        if self.asked.tolerance_of == ErrorKind.RMS:
            return self.bound(counts)
        limited = self.energies
        if self.asked.harmonics is not None:
            functions = harmonics_of(self.sequence.n_frames, self.sequence.times)
            paths = functions.limited(limited.coefficients, self.asked.harmonics)
            limited = replace(limited, coefficients=paths)
        return largest_errors(
            self.sequence, self.template, self.ladder, limited, counts, self.asked
        )

    def best(self, known: dict[int, float]) -> tuple[float, int]:
        """Smallest error of all sets, and its number of modes."""
        counts = self.ladder.counts
        bounds = dict(zip(counts.tolist(), self.bound(counts).tolist(), strict=True))
        best = min(((error, count) for count, error in known.items()), default=(np.inf, 0))
        for count in sorted(bounds, key=lambda count: bounds[count]):
            if bounds[count] >= best[0]:
                break
            if known.get(count, np.inf) == np.inf:
                best = min(best, (float(self.of(np.array([count]))[0]), count))
        return best

    def _joint(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        functions = harmonics_of(self.sequence.n_frames, self.sequence.times)
        harmonics = self.asked.harmonics or 0
        require_harmonics(harmonics, functions)
        return self.energies.joint_rms(counts, functions)[:, harmonics]


def _ladder(
    sequence: MeshSequence, template: Template, asked: SignatureParameters, n_modes: int
) -> tuple[Ladder, Fit]:
    ladder = ladder_of(template, n_modes, sequence.grid)
    fit = fit_with(sequence, template, ladder.basis, asked)
    return by_energy(ladder, fit) if asked.order == ModeOrder.ENERGY else (ladder, fit)


def _until_noise(
    sequence: MeshSequence,
    template: Template,
    asked: SignatureParameters,
    smallest: ModeSet | SpringModes,
    scene: Scene,
) -> Model:
    most = asked.most_modes or MOST_MODES
    noise = measure_noise(sequence, template, asked)
    kind = simplest_with_noise(scene, noise, sequence)
    limit = noise_rms(noise, sequence.n_frames)
    choice = ModelChoice("auto", limit, ErrorKind.RMS, noise, kind, scene.errors, None)
    if kind == SceneKind.STATIC:
        found = static_model(sequence, template, smallest, scene.static, asked)
        return _noted(found, choice, sequence)
    is_simple = kind == SceneKind.RIGID and asked.remove_rotation
    if is_simple and asked.components == Components.CARTESIAN:
        return _noted(fit_model(sequence, template, smallest, asked), choice, sequence)
    n = min(_FIRST_FOR_NOISE, most)
    if asked.order == ModeOrder.ENERGY:
        n = most = asked.most_modes or ENERGY_POOL
    while True:
        ladder, fit = _ladder(sequence, template, asked, n)
        count = least_risk(ladder, energies_of(ladder.basis, fit), noise)
        if ladder.ends_because or n >= most or 4 * count <= 3 * ladder.counts[-1]:
            break
        n = min(2 * n, most)
    normal = None
    if _may_flatten(asked) and holds_noise(scene.planar.error.rms, noise, sequence, 1):
        normal = scene.planar.normal
    found = fit_model(sequence, template, ladder.modes(count), asked, normal=normal)
    notes = list(_notes_on(ladder, asked))
    if count == ladder.counts[-1]:
        reason = ladder.ends_because or "no more were allowed"
        notes.append(
            f"The residual of {count} modes still shows motion above the noise, but {reason}."
        )
    choice = replace(choice, normal=normal)
    return _noted(replace(found, notes=tuple(notes)), choice, sequence)


def measure_noise(sequence: MeshSequence, template: Template, asked: SignatureParameters) -> Noise:
    """Estimate a sequence's noise as its parameters measure displacements."""
    plain = replace(asked, components=Components.CARTESIAN, order=ModeOrder.FIXED)
    ladder, fit = _ladder(sequence, template, plain, _FIRST_FOR_NOISE)
    return estimate_noise(
        sequence,
        template,
        ladder,
        fit,
        reference=asked.reference,
        remove_rotation=asked.remove_rotation,
    )


def least_risk(ladder: Ladder, energies: Energies, noise: Noise) -> int:
    """Whole set whose expected distance from the motion without noise is least.

    A mode that is kept brings its noise, one that is dropped takes its motion with it, whose
    square is the coefficient's less that of its noise: an unbiased risk (Mallows, Some comments
    on C_p, Technometrics, 1973). Measured from the true reference a displacement carries the
    noise of its frame and of the reference; positions on the reference as recorded carry the
    latter whatever the modes. The set is the one that is nearest to the best for both.

    Parameters
    ----------
    ladder : Ladder
    energies : Energies
    noise : Noise
    """
    f = energies.n_frames
    variance = (noise.sigma / energies.scale) ** 2
    squares = (energies.coefficients**2).sum(axis=(0, 2)) / f
    noises = 6.0 * (f - 1) / f * variance * ladder.noise_shares
    counts = ladder.counts
    motion = np.append(np.cumsum((squares - noises)[::-1])[::-1], 0.0)[counts]
    motion = np.maximum(motion, 0.0)
    kept = np.concatenate([[0.0], np.cumsum(noises)])[counts]
    displaced, placed = motion + kept, motion + 3.0 * variance
    if not displaced.min() > 0.0:
        return int(counts[int(np.argmin(displaced))])
    excess = np.maximum(displaced / displaced.min(), placed / placed.min())
    return int(counts[int(np.argmin(excess))])


def _may_flatten(asked: SignatureParameters) -> bool:
    return asked.components == Components.CARTESIAN and asked.remove_rotation


def _notes_on(ladder: Ladder, asked: SignatureParameters) -> tuple[str, ...]:
    if asked.order == ModeOrder.FIXED:
        return ladder.notes
    note = (
        f"The modes are those that move most among the first {len(ladder.basis.modes)}; other "
        "sequences have others, and their amplitudes do not compare."
    )
    return (*ladder.notes, note)


def _noted(model: Model, choice: ModelChoice, sequence: MeshSequence) -> Model:
    unit = sequence.unit or "length units"
    notes = list(model.notes)
    if choice.noise is not None:
        notes.append(choice.noise.note(sequence.unit))
    kind, n = choice.scene, 3 * len(model.modes)
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


def _unreachable(
    sequence: MeshSequence,
    asked: SignatureParameters,
    limit: float,
    best: tuple[float, int],
    reason: str,
) -> ToleranceError:
    unit = sequence.unit or "length units"
    error, count = best
    in_mm = MM_PER_UNIT.get(sequence.unit or "")
    return ToleranceError(
        f"No set of modes holds {limit:.6g} {unit} ({asked.tolerance_of}): the best, of {count} "
        f"modes, leaves {error:.6g} {unit}; {reason}.",
        remedy=f"Allow {error * (1 + 1e-6):.7g} {unit} or more, or send a finer mesh.",
        details={
            "limit_asked": limit,
            "best_error": error,
            "best_error_mm": None if in_mm is None else error * in_mm,
            "best_modes": count,
            "error_of": asked.tolerance_of.value,
            "unit": sequence.unit,
        },
    )
