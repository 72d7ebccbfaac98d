"""What is asked of the encoder."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from modalmotion.errors import ParameterError


class Effort(StrEnum):
    """How much time the encoder may spend on trials."""

    FAST = "fast"
    BALANCED = "balanced"
    THOROUGH = "thorough"


class Measure(StrEnum):
    """What the asked number counts."""

    RMS = "rms"
    MAX_ERROR = "max_error"
    BYTES = "n_bytes"


@dataclass(frozen=True)
class Target:
    """One number, and what it counts."""

    measure: Measure
    value: float


def require_target(rms: float | None, max_error: float | None, n_bytes: int | None) -> Target:
    """Check that exactly one target is asked for, and that it can be met.

    Raises
    ------
    ParameterError
        Otherwise.
    """
    asked = {
        Measure.RMS: rms,
        Measure.MAX_ERROR: max_error,
        Measure.BYTES: n_bytes,
    }
    given = [(measure, value) for measure, value in asked.items() if value is not None]
    if len(given) != 1:
        raise ParameterError(
            f"Several targets were given: {', '.join(m for m, _ in given)}."
            if given
            else "Neither an error nor a size was asked for.",
            remedy="Ask for one of rms, max_error and bytes (in Python n_bytes).",
        )
    measure, value = given[0]
    if not (math.isfinite(value) and value > 0):
        raise ParameterError(
            f"The target {measure} = {value} is not positive and finite.",
            remedy="Ask for an error in the unit of the vertices, or a number of bytes.",
        )
    return Target(measure, float(value))
