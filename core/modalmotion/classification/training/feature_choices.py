"""Which features may be tried on some training cases."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from modalmotion.classification.features import FeatureReader
from modalmotion.classification.options import Timing, TrainingOptions, Walls
from modalmotion.classification.training.case_row import CaseRow
from modalmotion.errors import ParameterError
from modalmotion.signature.making import ModalSignature

# A cycle whose next frame would be the first closes within this many usual steps.
_CLOSED: Final = 2.5


def feature_choices(
    rows: list[CaseRow],
    example: ModalSignature,
    options: TrainingOptions,
    walls: bool,
    n_topologies: int,
) -> tuple[FeatureReader, ...]:
    """List the choices of features that may be tried, what depends on the least first.

    Empty where the cases have several topologies and no axis.
    """
    h = options.harmonics
    closes = float(np.median([row.gap for row in rows])) < _CLOSED
    timings = {Timing.CYCLE: [True], Timing.COURSE: [False]}.get(
        Timing(options.timing), [True, False] if closes else [False]
    )
    choices: list[FeatureReader] = []
    if timings[0] and all(row.axis is not None for row in rows):
        choices.append(FeatureReader(True, True, h, walls))
        if n_topologies == 1:
            choices.append(FeatureReader(True, True, h, walls, adds_modes=True))
    if n_topologies > 1:
        return tuple(choices)
    for is_cycle in timings:
        plain = FeatureReader(False, is_cycle, h, walls)
        choices += [replace(plain, is_brief=True), plain]
        # Terms as they are mean nothing where theta may start anywhere.
        if plain.waves(example).sines.max() < 0:
            terms = rows[0].cycle.terms if is_cycle else rows[0].course.terms
            choices.append(replace(plain, typical=np.zeros_like(terms)))
    return tuple(choices)


def domain_reader(choices: tuple[FeatureReader, ...]) -> FeatureReader:
    """Give what the domain reads, which does not depend on the choice that is made."""
    return replace(choices[0], is_brief=False)


def tells_walls(rows: list[CaseRow], options: TrainingOptions) -> bool:
    """Whether walls are told apart.

    Raises
    ------
    ParameterError
        If the options say so, but theta has no zero in some case.
    """
    if options.walls == Walls.NO:
        return False
    if options.walls == Walls.AUTO:
        return all(row.zero_is_given for row in rows)
    unknown = sum(not row.zero_is_known for row in rows)
    if unknown:
        raise ParameterError(
            f"Walls are to be told apart, but theta has no zero in {unknown} cases.",
            remedy="State the landmark theta_zero, or leave the option 'walls' out.",
        )
    return True
