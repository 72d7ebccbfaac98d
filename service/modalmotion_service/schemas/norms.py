"""Norms: requests to make one, descriptions, and deviations from them."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, FailFast, Field

from modalmotion.norm import Norm
from modalmotion.signature.making import MOST_MODES
from modalmotion_service.schemas.fields import JsonBody, SequenceId
from modalmotion_service.schemas.models import LabelledSequence, ModelName, in_the_longer_form


class NormRequest(JsonBody):
    """Name, controls and modes of a norm to make."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "name": "volunteers",
                    "sequences": ["0" * 64, {"id": "1" * 64, "subject": "v-02"}],
                    "modes": 7,
                }
            ]
        },
    )

    name: ModelName = Field(
        description="1 to 64 lower-case letters, digits, '.', '_' and '-', of no other norm."
    )
    sequences: Annotated[list[SequenceId | LabelledSequence], FailFast()] = Field(
        description="Ids of controls, one recording of each; subject and covariates are those "
        "stored with the sequence, or stated here. Labels are not read."
    )
    modes: int = Field(7, ge=1, le=MOST_MODES, description="Of the signatures.")
    topology: str | None = Field(
        None,
        max_length=80,
        description="Of the signatures; mesh for spring modes. All controls decide it together "
        "by default.",
    )

    @property
    def cases(self) -> list[LabelledSequence]:
        """All sequences in the longer form."""
        return in_the_longer_form(self.sequences)


class NormAnswer(BaseModel):
    """A norm, without any control's features."""

    name: str
    id: str = Field(description="sha256 of everything that its answers depend on.")
    n_controls: int
    topology: str
    n_modes: int
    features: str = Field(description="Kind of the features, in words.")
    groups: list[str] = Field(description="Groups of features that are answered one by one.")
    covariates: list[str] = Field(description="Those that all controls state.")
    smallest_level: float = Field(description="The smallest p-value that is possible.")
    has_volumes: bool = Field(description="Whether every control has its share of the volume.")
    notes: list[str]
    links: dict[str, str]

    @staticmethod
    def of(norm: Norm) -> NormAnswer:
        """Write a norm out."""
        return NormAnswer(**norm.as_json(), links={"self": f"/v1/norms/{norm.name}"})


class NormLink(BaseModel):
    """A norm in a list."""

    name: str
    links: dict[str, str]


class NormList(BaseModel):
    """All norms, by name."""

    norms: list[NormLink]

    @staticmethod
    def of(names: tuple[str, ...]) -> NormList:
        """Write the names out."""
        links = [NormLink(name=name, links={"self": f"/v1/norms/{name}"}) for name in names]
        return NormList(norms=links)


class DeviationQuery(BaseModel):
    """Which norm a sequence is compared with, and how rare a deviation is."""

    model_config = ConfigDict(extra="forbid")

    norm: ModelName = Field(description="Name of the norm.")
    level: float = Field(
        0.05,
        gt=0,
        le=0.5,
        description="Share of recordings like the controls that may be called a deviation.",
    )


class GroupDeviationAnswer(BaseModel):
    """One group of features beside the controls'."""

    name: str
    p: float = Field(description="Corrected for the number of groups.")
    p_alone: float
    share_less: float = Field(description="Share of the controls with less of it.")
    deviates: bool
    words: str


class QuantityDeviationAnswer(BaseModel):
    """A clinical quantity beside the controls'."""

    name: str
    value: float
    unit: str
    p: float = Field(description="Two-sided, of this quantity alone.")
    share_less: float = Field(description="Share of the controls with a smaller one.")


class DeviationAnswer(BaseModel):
    """A recording beside controls."""

    norm: str
    norm_id: str
    sequence_id: str
    n_controls: int = Field(description="Without the recording itself, where it is one of them.")
    level: float
    attainable: float = Field(
        description="Share of recordings like the controls that is called a deviation."
    )
    p: float = Field(description="Share of controls and recording that is at least as strange.")
    deviates: bool
    groups: list[GroupDeviationAnswer]
    quantities: list[QuantityDeviationAnswer]
    covariates: list[str] = Field(description="Those that are accounted for.")
    warnings: list[str] = Field(description="In what it was not recorded like the controls.")
    notes: list[str]


class CohortRequest(JsonBody):
    """Recordings to compare with a norm, each and together."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"sequences": ["0" * 64] * 5}]}
    )

    sequences: Annotated[list[SequenceId | LabelledSequence], FailFast()] = Field(
        description="Ids, at least five that are no controls; subject and covariates as for a norm."
    )
    level: float = Field(0.05, gt=0, le=0.5, description="Of each, and of the warning.")

    @property
    def cases(self) -> list[LabelledSequence]:
        """All sequences in the longer form."""
        return in_the_longer_form(self.sequences)


class CohortDeviationAnswer(BaseModel):
    """Recordings beside controls, each and together."""

    norm: str
    norm_id: str
    n_controls: int
    n_recordings: int
    level: float
    p: float = Field(
        description="That exchanging controls and recordings sets them as far apart, by chance."
    )
    is_another: bool = Field(
        description="Whether another machine, protocol or group of people stands behind: then "
        "single p-values speak of the cohort."
    )
    warning: str | None = Field(description="The same in words.")
    deviations: list[DeviationAnswer] = Field(description="In the order of the request.")
