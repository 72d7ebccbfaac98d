"""The row of one training case: its features, nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import FeatureReader, MotionTerms, has_axis, motion_of
from modalmotion.classification.features.course import measures
from modalmotion.classification.features.hand import hand_of, readings_of, right_handed
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.cases import TrainingCase
from modalmotion.classification.training.conditions import Conditions, conditions_of
from modalmotion.facts import UNKNOWN
from modalmotion.signature.making import ModalSignature
from modalmotion.template.landmarks import WEAK


class AxisValues(NamedTuple):
    """Values of `MotionFeatures` without the names."""

    values: NDArray[np.float64]
    motion: float
    smooth_share: float


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
    axis, walls : AxisValues or None
        Read about an axis; None where there is none, or no zero of theta.
    cycle, course : MotionTerms
    covariates : mapping of str to (float or str)
    allowed : (readings,) bool
        See `readings_of`.
    measures : (measures,) float64
        See `course.measures`.
    has_unit, hand_is_stated : bool
        Whether the unit and the handedness are known.
    """

    label: str
    subject: str | None
    sequence_id: str
    name: str
    conditions: Conditions
    gap: float
    zero_is_given: bool
    zero_is_known: bool
    axis: AxisValues | None
    walls: AxisValues | None
    cycle: MotionTerms
    course: MotionTerms
    covariates: Mapping[str, float | str]
    allowed: NDArray[np.bool_]
    measures: NDArray[np.float64]
    has_unit: bool
    hand_is_stated: bool


def case_row(case: TrainingCase, options: TrainingOptions) -> CaseRow:
    """Read the features of a case, in right-handed coordinates where it states left-handed ones."""
    signature = right_handed(case.signature)
    landmarks = signature.landmarks
    axis = walls = None
    if has_axis(signature):
        axis = _about_axis(signature, options, walls=False)
        if landmarks is not None:
            walls = _about_axis(signature, options, walls=True)
    kinds = [FeatureReader(False, is_cycle, options.harmonics, False) for is_cycle in (True, False)]
    cycle, course = (motion_of(signature, kind) for kind in kinds)
    return CaseRow(
        label=case.label,
        subject=case.subject,
        sequence_id=signature.sequence_id,
        name=case.name,
        conditions=conditions_of(signature),
        gap=signature.closure_gap,
        zero_is_given=landmarks is not None and "theta_zero" in landmarks.given,
        zero_is_known=zero_is_known(signature),
        axis=axis,
        walls=walls,
        cycle=cycle,
        course=course,
        covariates=case.covariates,
        allowed=readings_of(signature),
        measures=measures(signature),
        has_unit=signature.unit is not None,
        hand_is_stated=hand_of(signature.facts) != UNKNOWN,
    )


def _about_axis(signature: ModalSignature, options: TrainingOptions, *, walls: bool) -> AxisValues:
    features = FeatureReader(True, True, options.harmonics, walls).read(signature)
    # Without the names, which are the same for all cases.
    return AxisValues(features.values, features.motion, features.smooth_share)


def zero_is_known(signature: ModalSignature) -> bool:
    """Whether the shape or the sender says where theta starts."""
    landmarks = signature.landmarks
    return landmarks is not None and landmarks.strengths.get("theta_zero", 0.0) >= WEAK
