"""Flags of an answer: what is wrong with a recording, why, and what to do."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.course import MEASURES
from modalmotion.classification.features.twins import TWINS
from modalmotion.classification.model.domain import CHECKS, PLACE, Domain, Judgement, Sights

NO_MOTION: Final = "no motion"
NOISE: Final = "noise"
UNDETERMINED: Final = "undetermined"
UNREADABLE: Final = "unreadable"
OUT_OF_DOMAIN: Final = "out of domain"
MIRRORED: Final = "mirrored"
REVERSED: Final = "reversed time"
INVERTED: Final = "inverted motion"
INCOMPLETE: Final = "incomplete cycle"
SEVERAL: Final = "several cycles"
OTHER_SIZE: Final = "other size"
OTHER_SHAPE: Final = "other shape"
TOO_LARGE: Final = "motion too large"
TOO_SMALL: Final = "motion too small"

FLAGS: Final = (
    NO_MOTION,
    NOISE,
    UNDETERMINED,
    OUT_OF_DOMAIN,
    UNREADABLE,
    MIRRORED,
    REVERSED,
    INVERTED,
    INCOMPLETE,
    SEVERAL,
    OTHER_SIZE,
    OTHER_SHAPE,
    TOO_LARGE,
    TOO_SMALL,
)
"""Nothing moves; nothing but noise moves; amplitudes are less than their deviations; unlike any
training case; not a signature that the model reads (another topology, other modes, one frame); and
in what a recording is unlike the training cases, where that is known. Where one is set, there is no
label."""


class Flag(NamedTuple):
    """A flag with its words: what was found, and what to do about it."""

    name: str
    words: str


_OF_TWINS: Final = (
    Flag(
        MIRRORED,
        "its mirror image fits the training cases and the motion itself does not, as where one "
        "axis of the coordinates was negated. State the handedness (handedness=left), or send it "
        "in right-handed coordinates",
    ),
    Flag(
        REVERSED,
        "backwards it fits the training cases and as it is it does not. Check the order of the "
        "frames",
    ),
    Flag(
        INVERTED,
        "with the opposite direction it fits the training cases and as it is it does not: it "
        "moves out where these move in. Check the sign of the displacements",
    ),
)
_OF_CLOSING: Final = Flag(
    INCOMPLETE,
    "frames of the cycle are missing: from one frame to the next, or from the last to the first, "
    "it moves farther than any training case does. Send one whole cycle",
)
_RARELY_SO_LARGE: Final = Flag(
    TOO_LARGE,
    "training cases of about its size and shape hardly ever move so much, and usually several "
    "times less. Check the scale of the displacements",
)
_OF_TURNS: Final = Flag(
    SEVERAL,
    "it repeats itself: the recording holds several cycles, and a training case one. Cut out one "
    "cycle",
)


def flags_of(domain: Domain, judgement: Judgement, sights: Sights) -> tuple[Flag, ...]:
    """Give the flags of one recording beyond the limits of a domain, by what is wrong with it.

    Parameters
    ----------
    domain : Domain
    judgement : Judgement
        Of one recording.
    sights : Sights
        Of the same one.

    Returns
    -------
    tuple of Flag
        "out of domain" where nothing better is known of it.
    """
    scores = judgement.scores[0]
    beyond = dict(zip(CHECKS, (scores > domain.limits).tolist(), strict=True))
    flags = []
    repeats = sights.measures[0, MEASURES.index("turns")] > 0.0
    if beyond["turns"] and repeats:
        flags.append(_OF_TURNS)
    elif beyond["gap"] or beyond["leap"] or beyond["turns"]:
        flags.append(_OF_CLOSING)
    else:
        # The nearest twin explains the others, which share columns with it.
        gains = [
            gain if beyond[twin] else 0.0
            for twin, gain in zip(TWINS, judgement.gains[0].tolist(), strict=True)
        ]
        if max(gains) > 0.0:
            flags.append(_OF_TWINS[gains.index(max(gains))])
    if beyond["place"]:
        flags.append(_of_place(domain, sights.places[0]))
    elif not flags and domain.is_too_large(sights.places[0]):
        flags.append(_RARELY_SO_LARGE)
    if not flags and beyond["kind"]:
        words = (
            f"the motion is unlike any that the model was trained on (distance {scores[0]:.2f} "
            f"from the nearest class, limit {domain.limit:.2f})"
        )
        flags.append(Flag(OUT_OF_DOMAIN, words))
    return tuple(flags)


def _of_place(domain: Domain, place: NDArray[np.float64]) -> Flag:
    """Say in what size, shape or amount of motion are other than those of the training cases."""
    low, high = domain.points.min(axis=0), domain.points.max(axis=0)
    outside = np.nan_to_num(np.maximum(low - place, place - high) / domain.scales)
    outside[np.isinf(domain.scales)] = 0.0
    farthest = PLACE[int(outside.argmax())] if outside.max() > 0.0 else ""
    if farthest == "size":
        least, most, own = (math.exp(value[1]) for value in (low, high, place))
        unit = " mm" if domain.has_unit else ""
        return Flag(
            OTHER_SIZE,
            f"its size is {own:.3g}{unit}, and those of the training cases are {least:.3g} to "
            f"{most:.3g}{unit}. Check the unit, or train with surfaces of this size",
        )
    if farthest in PLACE[2:]:
        return Flag(
            OTHER_SHAPE,
            "its surface is longer or shorter for its width than that of any training case. "
            "Check that it is the surface that the model is for",
        )
    usual = float(np.median(domain.nearby(place[None])[0, :, 0]))
    share = f"{math.exp(place[0]):.2%} of its size, {math.exp(place[0] - usual):.2g} times"
    words = f"it moves by {share} what training cases of about its size and shape do. Check the"
    if place[0] > usual:
        return Flag(TOO_LARGE, f"{words} scale of the displacements")
    return Flag(TOO_SMALL, f"{words} scale of the displacements, and their smoothing")
