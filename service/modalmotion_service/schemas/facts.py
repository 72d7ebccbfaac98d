"""Facts as they stand in a query, in an answer and in a change."""

from __future__ import annotations

from typing import Any, Final

from pydantic import BaseModel, Field

from modalmotion.facts import NAMES, Facts, facts_as_json, facts_from_texts
from modalmotion.facts.facts import (
    LONGEST_MODALITY,
    Cavity,
    CoordinateSystem,
    Handedness,
    Tracking,
)
from modalmotion_service.schemas.fields import JsonBody

_LONGEST_JSON: Final = 50_000

TRACKING: Final = "Whether vertices follow tissue (material) or slide over it (offset)."
COORDINATES: Final = "Which way x, y and z point in a patient; both are right-handed."
PERIOD: Final = "Of a cycle, in s; at least what the times span."
CAVITY: Final = "Cavity that the surface encloses."
MODALITY: Final = "How it was recorded: MR, CT, US, simulated."
LANDMARKS: Final = (
    "By name: the number of a vertex, or a point [x, y, z]; apex, base, theta_zero and corners "
    "(four) place the natural coordinates."
)
COVARIATES: Final = "By name: a number or a word."


class FactsQuery(BaseModel):
    """Facts of a sequence beside its arrays; they override those in the file."""

    tracking: Tracking | None = Field(None, description=TRACKING)
    handedness: Handedness | None = Field(None, description="Of the coordinate system.")
    coordinates: CoordinateSystem | None = Field(None, description=COORDINATES)
    period: float | None = Field(None, gt=0, allow_inf_nan=False, description=PERIOD)
    cavity: Cavity | None = Field(None, description=CAVITY)
    modality: str | None = Field(None, max_length=LONGEST_MODALITY, description=MODALITY)
    landmarks: str | None = Field(
        None, max_length=_LONGEST_JSON, description=f"As JSON. {LANDMARKS}"
    )
    covariates: str | None = Field(
        None, max_length=_LONGEST_JSON, description=f"As JSON. {COVARIATES}"
    )

    def facts(self) -> Facts:
        """Translate to the library's facts.

        Raises
        ------
        ParameterError
            If one cannot be read, or two contradict each other.
        """
        return facts_from_texts({name: getattr(self, name) for name in NAMES})


class FactsAnswer(BaseModel):
    """Facts of a sequence beside its arrays; not part of its id."""

    tracking: Tracking = Field(description=TRACKING)
    handedness: Handedness
    coordinates: CoordinateSystem = Field(description=COORDINATES)
    period: float | None = Field(description=PERIOD)
    cavity: Cavity = Field(description=CAVITY)
    modality: str | None = Field(description=MODALITY)
    landmarks: dict[str, int | list[int | float | list[float]]] = Field(description=LANDMARKS)
    covariates: dict[str, int | float | str] = Field(description=COVARIATES)

    @staticmethod
    def of(facts: Facts) -> FactsAnswer:
        """Write facts out."""
        return FactsAnswer.model_validate(facts_as_json(facts))


class FactsPatch(JsonBody):
    """A change of facts: what is left out stays, null makes it unknown."""

    tracking: Tracking | None = Field(None, description=TRACKING)
    handedness: Handedness | None = None
    coordinates: CoordinateSystem | None = Field(None, description=COORDINATES)
    period: float | None = Field(None, gt=0, allow_inf_nan=False, description=PERIOD)
    cavity: Cavity | None = Field(None, description=CAVITY)
    modality: str | None = Field(None, max_length=LONGEST_MODALITY, description=MODALITY)
    # Their values are checked by the library, which stops at the first fault.
    landmarks: dict[str, Any] | None = Field(
        None, description=f"Changed by name; null takes one away. {LANDMARKS}"
    )
    covariates: dict[str, Any] | None = Field(
        None, description=f"Changed by name; null takes one away. {COVARIATES}"
    )

    @property
    def changes(self) -> dict[str, Any]:
        """The stated facts, as `facts_patched` takes them."""
        return {name: getattr(self, name) for name in self.model_fields_set}
