"""Distances between signatures."""

from __future__ import annotations

from pydantic import BaseModel, Field


class DistanceAnswer(BaseModel):
    """Distance of one sequence's signature from another's."""

    distance: float = Field(description="|a - b| / |b| in the frame of the body, by phase.")
    uses_theta_zero: bool = Field(
        description="False where the zero of theta is not determined: magnitudes of pairs are "
        "compared then."
    )
    by_errors: float | None = Field(
        description="Distance that the stated deviations of both would make by themselves, RMS: "
        "one no larger than it shows no difference. Null where neither has deviations."
    )
