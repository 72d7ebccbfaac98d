"""The smallest set of modes that holds a tolerance."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from modalmotion.choice.fitted_motion import Model, fit_model
from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder
from modalmotion.choice.ordered_sets import ENERGY_POOL, notes_on, sorted_ladder
from modalmotion.choice.parameters import MOST_MODES, ErrorKind, ModeOrder
from modalmotion.choice.reason import COMPACT, note_on_compactness
from modalmotion.choice.set_errors import SetErrors
from modalmotion.errors import ToleranceError
from modalmotion.fit.basis import make_basis
from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.numerals import counted
from modalmotion.numeric.scale import root_mean_square

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
    most = parameters.most_modes or MOST_MODES
    n = min(_FIRST, most)
    if parameters.order == ModeOrder.ENERGY:
        n = most = parameters.most_modes or ENERGY_POOL
    known: dict[int, float] = {}
    while True:
        ladder, fit = sorted_ladder(fitter, n)
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
                        notes = (*notes_on(ladder, parameters), *_on_size(errors, count))
                        return replace(model, notes=notes)
        if ladder.ends_because or n >= most:
            best = errors.best(known)
            is_weighted = parameters.tolerance_of == ErrorKind.WEIGHTED_RMS
            motion = fit.weighted_motion_rms if is_weighted else fit.motion_rms
            raise _unreachable(fitter, limit, best, ladder, root_mean_square(motion))
        known.setdefault(int(ladder.counts[-1]), np.inf)
        n = min(2 * n, most)


def _on_size(errors: SetErrors, count: int) -> tuple[str, ...]:
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
    fitter: Fitter,
    limit: float,
    best: tuple[float, int],
    ladder: Ladder,
    motion: float,
) -> ToleranceError:
    """Error that names what to allow, as the request puts it: in mm, or as a share of the motion.

    Parameters
    ----------
    fitter : Fitter
    limit : float, length unit
    best : (float, int)
        Smallest error, length unit, and its number of modes.
    ladder : Ladder
        All that were tried.
    motion : float, length unit
        RMS motion.
    """
    parameters, unit = fitter.parameters, fitter.sequence.unit or "length units"
    error, count = best
    in_mm = MM_PER_UNIT.get(unit)
    if parameters.tolerance is None:
        allowed = f"a tolerance_share of {error / (motion or 1.0) * (1 + 1e-6):.7g}"
    else:
        allowed = f"a tolerance of {error * (in_mm or 1.0) * (1 + 1e-6):.7g} mm"
    reason, other = ladder.ends_because, ""
    if not reason:
        reason = f"no more than {ladder.counts[-1]} were allowed"
        is_stated = parameters.most_modes is not None or parameters.order == ModeOrder.ENERGY
        if is_stated and count < MOST_MODES:
            other = ", or a larger most_modes"
    return ToleranceError(
        f"No set of modes holds {limit:.6g} {unit} ({parameters.tolerance_of}): the best, of "
        f"{count} modes, leaves {error:.6g} {unit}; {reason}.",
        remedy=f"Allow {allowed} or more{other}.",
        details={
            "limit_asked": limit,
            "best_error": error,
            "best_error_mm": None if in_mm is None else error * in_mm,
            "best_modes": count,
            "error_of": parameters.tolerance_of.value,
            "unit": fitter.sequence.unit,
        },
    )
