"""Sets of modes one inside the other, in the order that was asked for."""

from __future__ import annotations

from typing import Final

from modalmotion.choice.energy_order import by_energy
from modalmotion.choice.fitted_motion import fit_with
from modalmotion.choice.nested_sets import Ladder, ladder_of
from modalmotion.choice.parameters import ModeOrder, SignatureParameters
from modalmotion.fit.fit import Fit
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.template import Template

ENERGY_POOL: Final = 200
"""Modes among which those with most energy are looked for, unless `most_modes` says."""


def sorted_ladder(
    sequence: MeshSequence, template: Template, asked: SignatureParameters, n_modes: int
) -> tuple[Ladder, Fit]:
    """Give modes in the order asked for, lowest or with most energy first, and their fit."""
    ladder = ladder_of(template, n_modes, sequence.grid)
    fit = fit_with(sequence, template, ladder.basis, asked)
    return by_energy(ladder, fit) if asked.order == ModeOrder.ENERGY else (ladder, fit)


def notes_on(ladder: Ladder, asked: SignatureParameters) -> tuple[str, ...]:
    """Tell what a user should know of modes that were chosen from a ladder."""
    if asked.order == ModeOrder.FIXED:
        return ladder.notes
    note = (
        f"The modes are those that move most among the first {len(ladder.basis.modes)}; other "
        "sequences have others, and their amplitudes do not compare."
    )
    return (*ladder.notes, note)
