"""Targets and efforts of the encoder."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from modalmotion.errors import ParameterError
from modalmotion.numeric.kinds import real, whole


class Effort(StrEnum):
    """How much time the encoder may spend on trials, and the decoder on modes."""

    FAST = "fast"
    BALANCED = "balanced"


class Measure(StrEnum):
    """The quantity that a target bounds."""

    RMS = "rms"
    MAX_ERROR = "max_error"
    BYTES = "n_bytes"


@dataclass(frozen=True)
class Target:
    """One bound, and its quantity."""

    measure: Measure
    value: float


USUAL_SHARE: Final = 0.003
"""Largest error, as a share of the diagonal of the sequence's bounding box, if no target is set."""


def require_target(
    rms: float | None, max_error: float | None, n_bytes: int | None, usual: float
) -> Target:
    """Check that there is at most one target, positive and finite.

    Parameters
    ----------
    rms, max_error : float or None, length unit
    n_bytes : int or None
    usual : float, length unit
        Largest error if none of them is given.

    Raises
    ------
    ParameterError
        Otherwise.
    """
    bounds = {
        Measure.RMS: rms,
        Measure.MAX_ERROR: max_error,
        Measure.BYTES: n_bytes,
    }
    targets = [(measure, value) for measure, value in bounds.items() if value is not None]
    if not targets:
        return Target(Measure.MAX_ERROR, usual)
    if len(targets) > 1:
        raise ParameterError(
            f"Several targets are set: {', '.join(m for m, _ in targets)}.",
            remedy="Set one of rms, max_error and bytes (in Python n_bytes).",
        )
    measure, value = targets[0]
    value = (whole if measure == Measure.BYTES else real)(measure.value, value)
    if not (math.isfinite(value) and value > 0):
        raise ParameterError(
            f"The target {measure} = {value} is not positive and finite.",
            remedy="Ask for an error in the unit of the vertices, or a number of bytes.",
        )
    return Target(measure, float(value))
