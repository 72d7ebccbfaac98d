"""Which features may be tried on some training cases."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import FeatureReader, Further, covariate_columns
from modalmotion.classification.features.patterns import no_patterns
from modalmotion.classification.options import MODE_COUNTS, Timing, TrainingOptions, Walls
from modalmotion.classification.training.case_row import (
    CaseRow,
    FurtherKey,
    TermsKey,
    harmonic_counts,
)
from modalmotion.errors import ParameterError
from modalmotion.signature.making import ModalSignature

# A cycle whose next frame would be the first closes within this many usual steps.
_CLOSED: Final = 2.5

# Factor of the prior for each step that makes a choice less simple.
_PRIOR: Final = 0.7

# Surfaces whose first modes are the same; those of a sphere are others.
_OPEN_AT_BASE: Final = frozenset({"cup", "cylinder"})

# Prior of the volume over that of all others together.
_PRIOR_OF_VOLUME: Final = 20.0


def feature_choices(
    rows: list[CaseRow],
    example: ModalSignature,
    options: TrainingOptions,
    walls: bool,
    topologies: Collection[str],
) -> tuple[FeatureReader, ...]:
    """List the choices of features of the motion that may be weighed, the simplest first.

    Empty where the cases have several topologies that do not mix.
    """
    h = options.harmonics
    closes = float(np.median([row.gap for row in rows])) < _CLOSED
    timings = {Timing.CYCLE: [True], Timing.COURSE: [False]}.get(
        Timing(options.timing), [True, False] if closes else [False]
    )
    choices: list[FeatureReader] = []
    counts = sorted(set.intersection(*(set(row.counts) for row in rows)))
    for n in counts:
        about_axis = mixes(topologies) and all((n, walls) in row.axis for row in rows)
        if timings[0] and about_axis:
            choices.append(FeatureReader(True, True, h, walls, n_modes=n))
        if len(topologies) > 1:
            continue
        for is_cycle in timings:
            for n_harmonics in harmonic_counts(h, is_cycle=is_cycle):
                plain = FeatureReader(False, is_cycle, n_harmonics, walls, n_modes=n)
                choices += [replace(plain, is_brief=True), plain]
                # Terms as they are mean nothing where theta may start anywhere.
                if plain.waves(example).sines.max() < 0:
                    terms = rows[0].terms[TermsKey(n, is_cycle, n_harmonics)].terms
                    choices.append(replace(plain, typical=np.zeros_like(terms)))
                    finest = n_harmonics == harmonic_counts(h, is_cycle=False)[-1]
                    if n == counts[0] and finest and not is_cycle:
                        choices.append(replace(plain, patterns=no_patterns()))
    return tuple(choices)


def mixes(topologies: Collection[str]) -> bool:
    """Whether motions of surfaces of these topologies have the same parts about their axes."""
    return len(topologies) == 1 or _OPEN_AT_BASE.issuperset(topologies)


def further_kinds(
    rows: Sequence[CaseRow],
    covariates: Sequence[Mapping[str, float | str]],
    reader: FeatureReader,
    n_topologies: int,
) -> tuple[Further, ...]:
    """Kinds of features beside the motion that all cases have, and that compare."""
    kinds = [
        kind
        for kind in (Further.SIZE, Further.REST_SHAPE, Further.VOLUME, Further.VOLUME_CURVE)
        if (kind != Further.REST_SHAPE or n_topologies == 1)
        and all(
            FurtherKey(kind, reader.n_modes, reader.is_cycle, reader.walls) in row.further
            for row in rows
        )
    ]
    if covariate_columns(covariates):
        kinds.append(Further.COVARIATES)
    return tuple(kinds)


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


def prior_weights(readers: Sequence[FeatureReader]) -> NDArray[np.float64]:
    """Weights of choices before any case is seen: the volume first, then the simplest.

    Parameters
    ----------
    readers : sequence of FeatureReader

    Returns
    -------
    (choices,) float64
        They add up to 1.
    """
    is_volume = np.array([r.further == (Further.VOLUME,) and not r.reads_motion for r in readers])
    weights = np.array([_PRIOR ** _complexity(reader) for reader in readers])
    others = float(weights[~is_volume].sum())
    weights[is_volume] = _PRIOR_OF_VOLUME * others if others else 1.0
    total: NDArray[np.float64] = weights / weights.sum()
    return total


def _complexity(reader: FeatureReader) -> float:
    """Count the steps by which a choice is less simple than another."""
    steps = float(len(reader.further))
    if reader.reads_motion:
        steps += 0.0 if reader.has_axis or reader.is_brief else 1.0
        steps += reader.typical is not None
    return steps + sum(reader.n_modes > n for n in MODE_COUNTS[:-1]) / 2.0
