"""A motion read in right-handed coordinates; both ways, where its handedness is not known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.answer.flags import (
    NO_MOTION,
    NOISE,
    UNDETERMINED,
    Flag,
    flags_of,
)
from modalmotion.classification.features import READINGS, Columns, KnownFeatures, MotionFeatures
from modalmotion.classification.features.course import measures
from modalmotion.classification.features.hand import (
    hand_of,
    mirrored,
    readings_of,
    right_handed,
    theta_is_of_the_shape,
)
from modalmotion.classification.features.temporal import Turn
from modalmotion.classification.features.twins import of_kinds, twin_signs
from modalmotion.classification.model.domain import Domain, Judgement, Sights, sights_of
from modalmotion.classification.model.model import Model
from modalmotion.facts import UNKNOWN
from modalmotion.signature.making import ModalSignature

# Of the amplitudes: above it probabilities were too sure (docs/decisions/0039).
_UNSURE = 0.2

_COLUMNS_NOTE = (
    "The columns run left-handed about the axis from the apex; the motion was read accordingly."
)


@dataclass(frozen=True, eq=False)
class Reading:
    """A motion as a model reads it.

    Parameters
    ----------
    signature : ModalSignature
        In right-handed coordinates.
    seen : MotionFeatures
        By the domain.
    sights : Sights
        Of this one recording.
    judgement : Judgement
    values : (features,) float64
        Of the model, in the reading that is nearest to a class.
    columns : Columns
    """

    signature: ModalSignature
    seen: MotionFeatures
    sights: Sights
    judgement: Judgement
    values: NDArray[np.float64]
    columns: Columns

    def flags(self, domain: Domain) -> tuple[Flag, ...]:
        """Give what speaks against an answer."""
        seen = self.seen
        if seen.motion < domain.least_motion or seen.motion == 0.0:
            words = (
                f"no motion: it deforms by {seen.motion:.2%} of its size, less than "
                f"{domain.least_motion:.2%}"
            )
            return (Flag(NO_MOTION, words),)
        if seen.smooth_share < domain.least_smooth:
            words = (
                "the motion is mostly noise from frame to frame (a smooth one would hold 1, this "
                f"one {seen.smooth_share:.2f})"
            )
            return (Flag(NOISE, words),)
        share = self.signature.deviation_share
        if share is not None and share >= 1.0:
            words = (
                f"the amplitudes are not determined: their standard deviations are {share:.2g} "
                "times as large as they are. Record more points, or points of more of the surface"
            )
            return (Flag(UNDETERMINED, words),)
        return flags_of(domain, self.judgement, self.sights)


@dataclass(frozen=True, eq=False)
class Hands:
    """One or two readings of a motion, and what comes of them.

    Parameters
    ----------
    better : Reading
        The one that fits the training cases better.
    other : Reading or None
        In coordinates of the other handedness, where it is not known.
    weights : (readings,) float64
        Probabilities that the motion is as the better and as the other say.
    shares : (readings, classes) float64
        Probabilities of the classes, of each.
    is_as_sent : bool
        Whether the better one takes the recording to be right-handed.
    """

    better: Reading
    other: Reading | None
    weights: NDArray[np.float64]
    shares: NDArray[np.float64]
    is_as_sent: bool

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """Of the classes, (classes,): their mean, so that none is surer than both readings."""
        if self.other is None:
            return np.asarray(self.shares[0])
        return np.asarray(self.weights @ self.shares)

    def notes(self, classes: tuple[str, ...]) -> tuple[str, ...]:
        """Say of the readings what a user needs."""
        notes = []
        share = self.better.signature.deviation_share
        if share:
            text = f"The standard deviations of its amplitudes are {share:.0%} of them"
            if share >= _UNSURE:
                text += ", which the probabilities do not contain: they are too sure"
            notes.append(f"{text}.")
        both = READINGS[int(self.better.judgement.readings[0])]
        if both.is_mirrored:
            notes.append(_COLUMNS_NOTE)
        if self.other is not None:
            order = [0, 1] if self.is_as_sent else [1, 0]
            right, left = (
                f"{classes[int(self.shares[k].argmax())]} ({self.shares[k].max():.2f})"
                for k in order
            )
            weight = self.weights[order[0]]
            notes.append(
                f"Its handedness is not stated. Right-handed it would be {right}, left-handed "
                f"{left}; the answer weighs both, {weight:.2f} to {1.0 - weight:.2f}, by how well "
                "they fit. State the handedness to settle it."
            )
        return tuple(notes)


def read_hands(signature: ModalSignature, model: Model) -> Hands:
    """Read a motion in right-handed coordinates.

    Where its handedness is not known, and the training cases state theirs, it is read both ways.
    A model of cases that state none takes a recording as it took them.
    """
    first = _read(right_handed(signature), model)
    domain = model.domain
    is_known = hand_of(signature.facts) != UNKNOWN or not domain.hand_is_stated
    if is_known or first.seen.motion == 0.0:
        return Hands(first, None, np.ones(1), model.probabilities(first.values[None]), True)
    second = _read(mirrored(signature), model)
    evidence = float(first.judgement.hand[0]) / domain.hand_temperature
    weight = 1.0 / (1.0 + math.exp(min(evidence, 700.0)))
    pair = [(first, weight), (second, 1.0 - weight)]
    if weight < 0.5:
        pair.reverse()
    (better, _), (other, _) = pair
    return Hands(
        better,
        other,
        np.array([share for _, share in pair]),
        model.probabilities(np.stack([better.values, other.values])),
        weight >= 0.5,
    )


def _read(signature: ModalSignature, model: Model) -> Reading:
    """Read the features in the reading that is nearest to what the model knows."""
    domain = model.domain
    known = KnownFeatures()
    seen = domain.reader.read(signature, known)
    turn = known.turns(signature).of_first()
    sights = _sights(signature, seen, domain, turn)
    judgement = domain.judge(sights)
    features = model.read(signature, known)
    nearest = int(judgement.readings[0])
    return Reading(
        signature=signature,
        seen=seen,
        sights=sights,
        judgement=judgement,
        values=features.values[nearest if len(features.values) > 1 else 0],
        columns=features.columns,
    )


def _sights(signature: ModalSignature, seen: MotionFeatures, domain: Domain, turn: Turn) -> Sights:
    signs = twin_signs(seen.columns, mirror_turns_theta=theta_is_of_the_shape(signature))
    values = measures(signature, turn)
    if domain.has_unit is None or domain.has_unit != (signature.unit is not None):
        values[0] = math.nan
    return sights_of(seen.kinds[None], readings_of(signature)[None], of_kinds(signs), values[None])
