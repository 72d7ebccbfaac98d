"""The row of one training case: its features, nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.parameters import ModeOrder
from modalmotion.classification.features import (
    FeatureReader,
    Further,
    KnownFeatures,
    MotionTerms,
    MotionValues,
    further_values,
    has_axis,
    has_volume,
)
from modalmotion.classification.features.course import measures
from modalmotion.classification.features.hand import hand_of, readings_of, right_handed
from modalmotion.classification.options import MODE_COUNTS, MOST_HARMONICS, TrainingOptions
from modalmotion.classification.training.cases import TrainingCase
from modalmotion.classification.training.conditions import Conditions, conditions_of
from modalmotion.facts import UNKNOWN
from modalmotion.modes.order import common_count
from modalmotion.signature.first_modes import first_modes, whole_count
from modalmotion.signature.making import ModalSignature
from modalmotion.template.landmarks import WEAK


class TermsKey(NamedTuple):
    """Modes, time and number of the terms of a motion.

    Parameters
    ----------
    n_modes : int
    is_cycle : bool
    n_harmonics : int
    """

    n_modes: int
    is_cycle: bool
    n_harmonics: int


class FurtherKey(NamedTuple):
    """Feature beside the motion, and what it depends on.

    Parameters
    ----------
    kind : Further
    n_modes : int
    is_cycle, walls : bool
    """

    kind: Further
    n_modes: int
    is_cycle: bool
    walls: bool


@dataclass(frozen=True, eq=False)
class CaseRow:
    """Features of one training case, in every form that training may try.

    Parameters
    ----------
    label : str
    subject : str or None
    sequence_id : str
    name : str
        What errors call the case; may be empty.
    conditions : Conditions
    gap : float
        See `ModalSignature.closure_gap`.
    zero_is_given, zero_is_known : bool
        Whether the sender says where theta starts, and whether anything does.
    counts : tuple of int
        Numbers of first modes that features may be read of, increasing.
    axis : mapping of (int, bool) to MotionValues
        By number of modes and whether walls are told apart: read about an axis; empty where
        there is none, or no zero of theta.
    terms : mapping of TermsKey to MotionTerms
    further : mapping of FurtherKey to (features,) float64
        Kinds that the case has.
    covariates : mapping of str to (float or str)
    allowed : (readings,) bool
        See `readings_of`.
    measures : (measures,) float64
        See `course.measures`.
    has_unit, hand_is_stated : bool
        Whether the unit and the handedness are known.
    tracking : str
        As the facts state it.
    """

    label: str
    subject: str | None
    sequence_id: str
    name: str
    conditions: Conditions
    gap: float
    zero_is_given: bool
    zero_is_known: bool
    counts: tuple[int, ...]
    axis: Mapping[tuple[int, bool], MotionValues]
    terms: Mapping[TermsKey, MotionTerms]
    further: Mapping[FurtherKey, NDArray[np.float64]]
    covariates: Mapping[str, float | str]
    allowed: NDArray[np.bool_]
    measures: NDArray[np.float64]
    has_unit: bool
    hand_is_stated: bool
    tracking: str


def case_row(case: TrainingCase, options: TrainingOptions) -> CaseRow:
    """Read the features of a case, in right-handed coordinates where it states left-handed ones."""
    signature = right_handed(case.signature)
    landmarks = signature.landmarks
    axis: dict[tuple[int, bool], MotionValues] = {}
    terms: dict[TermsKey, MotionTerms] = {}
    further: dict[FurtherKey, NDArray[np.float64]] = {}
    counts, known = mode_counts(signature), KnownFeatures()
    motion = known.motion(signature)
    for n in counts:
        few = first_modes(signature, n)
        if has_axis(few):
            for walls in (False, True) if landmarks is not None else (False,):
                reader = FeatureReader(True, True, options.harmonics, walls, n_modes=n)
                # Without the names, which are the same for all cases.
                axis[n, walls] = reader.motion(signature, known)
        for is_cycle in (True, False):
            for n_harmonics in harmonic_counts(options.harmonics, is_cycle=is_cycle):
                found = motion.terms(n, n_harmonics, is_cycle=is_cycle)
                terms[TermsKey(n, is_cycle, n_harmonics)] = found
            for walls in (False, True):
                _add_further(further, few, is_cycle=is_cycle, walls=walls)
    return CaseRow(
        label=case.label,
        subject=case.subject,
        sequence_id=signature.sequence_id,
        name=case.name,
        conditions=conditions_of(signature),
        gap=signature.closure_gap,
        zero_is_given=landmarks is not None and "theta_zero" in landmarks.given,
        zero_is_known=zero_is_known(signature),
        counts=counts,
        axis=axis,
        terms=terms,
        further=further,
        covariates=case.covariates,
        allowed=readings_of(signature),
        measures=measures(signature),
        has_unit=signature.unit is not None,
        hand_is_stated=hand_of(signature.facts) != UNKNOWN,
        tracking=signature.facts.tracking,
    )


def mode_counts(signature: ModalSignature) -> tuple[int, ...]:
    """Numbers of first modes that features are read of: the usual ones, and all that compare."""
    modes, is_fixed = signature.modes, signature.parameters.order == ModeOrder.FIXED
    most = common_count(modes) if is_fixed else len(modes)
    usual = {whole_count(modes, n) for n in MODE_COUNTS if n <= most}
    return tuple(sorted({n for n in usual if n <= most} | {most}))


def harmonic_counts(n_harmonics: int, *, is_cycle: bool) -> tuple[int, ...]:
    """Numbers of harmonics that are tried: of a course, which turns at any time, twice as many."""
    return (n_harmonics,) if is_cycle else (n_harmonics, min(2 * n_harmonics, MOST_HARMONICS))


def _add_further(
    further: dict[FurtherKey, NDArray[np.float64]],
    signature: ModalSignature,
    *,
    is_cycle: bool,
    walls: bool,
) -> None:
    kinds = [Further.SIZE]
    if signature.reference_amplitudes.any():
        kinds.append(Further.REST_SHAPE)
    if has_volume(signature):
        kinds += [Further.VOLUME, Further.VOLUME_CURVE]
    waves = FeatureReader(False, is_cycle, 1, walls).waves(signature)
    for kind in kinds:
        further[FurtherKey(kind, len(signature.modes), is_cycle, walls)] = further_values(
            kind, signature, waves, is_cycle=is_cycle
        )


def zero_is_known(signature: ModalSignature) -> bool:
    """Whether the shape or the sender says where theta starts."""
    landmarks = signature.landmarks
    return landmarks is not None and landmarks.strengths.get("theta_zero", 0.0) >= WEAK
