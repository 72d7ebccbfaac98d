"""Sets of modes one inside the other, in the requested order."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder, ladder_of
from modalmotion.choice.parameters import ModeOrder, SignatureParameters
from modalmotion.fit.basis import Basis
from modalmotion.fit.fit import Fit
from modalmotion.numeric.products import product
from modalmotion.numeric.qr import tall_qr

ENERGY_POOL: Final = 200
"""Modes from which those with most energy are taken, unless `most_modes` is set."""


def sorted_ladder(fitter: Fitter, n_modes: int) -> tuple[Ladder, Fit]:
    """Modes in the requested order, lowest or most energetic first, and their fit."""
    ladder = ladder_of(fitter.template, n_modes, fitter.sequence.grid)
    return in_order(fitter, ladder)


def in_order(fitter: Fitter, ladder: Ladder) -> tuple[Ladder, Fit]:
    """Fit a ladder's largest set, and order it as the parameters ask."""
    fit = fitter.fit(ladder.basis)
    return by_energy(ladder, fit) if fitter.parameters.order == ModeOrder.ENERGY else (ladder, fit)


def notes_on(ladder: Ladder, parameters: SignatureParameters) -> tuple[str, ...]:
    """Caveats about modes chosen from a ladder."""
    if parameters.order == ModeOrder.FIXED:
        return ladder.notes
    note = (
        f"The modes are those that move most among the first {len(ladder.basis.modes)}; other "
        "sequences have others, and their amplitudes do not compare."
    )
    return (*ladder.notes, note)


def by_energy(ladder: Ladder, fit: Fit) -> tuple[Ladder, Fit]:
    """Order a ladder by energy: the mean first, then whole pairs, those that move most first.

    The energy of a mode is its mean squared amplitude in the fit of the largest set. The
    shapes are not factored again: those of W^(1/2) Phi P are Q times those of R P.

    Parameters
    ----------
    ladder : Ladder
        In the fixed order.
    fit : Fit
        Of its largest set.

    Raises
    ------
    ParameterError
        If the modes are the springs' of one mesh: their names are their ranks.
    """
    basis = ladder.basis
    scale = float(np.abs(fit.amplitudes).max(initial=0.0)) or 1.0
    energy = ((fit.amplitudes / scale) ** 2).sum(axis=2).mean(axis=0)
    groups = np.split(np.arange(len(basis.modes)), ladder.counts[:-1])
    rest = sorted(groups[1:], key=lambda group: -float(energy[group].sum()))
    order = np.concatenate([groups[0], *rest])
    modes = basis.modes.take(order)
    Q, R = tall_qr(basis.triangle[:, order])
    turned = Basis(
        modes,
        np.ascontiguousarray(basis.shapes[:, order]),
        R,
        product(np.ascontiguousarray(Q.T), basis.analysis),
        basis.condition,
    )
    counts = np.cumsum([len(groups[0]), *map(len, rest)])
    reordered = replace(ladder, basis=turned, counts=counts.astype(np.int64))
    return reordered, replace(fit, amplitudes=np.ascontiguousarray(fit.amplitudes[:, order]))
