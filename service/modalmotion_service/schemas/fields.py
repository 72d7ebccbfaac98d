"""Names, JSON bodies and pages: what requests of several calls have in common."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator
from pydantic_core import PydanticCustomError

from modalmotion.store import NAME_PATTERN, VERSION_PATTERN

JobId = Annotated[str, StringConstraints(pattern="^[0-9a-f]{32}$")]

SequenceId = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]

SignatureKey = Annotated[
    str,
    StringConstraints(pattern="^[0-9a-f]{64}(-[0-9a-f]{16})?$"),
    Field(
        description="As the answer to the making of the signature names it; or the id of a "
        "sequence, for its signature with the parameters that are usual, kept or not."
    ),
]

ModelName = Annotated[str, StringConstraints(pattern=f"^{NAME_PATTERN}$")]

ModelReference = Annotated[
    str,
    StringConstraints(pattern=f"^{NAME_PATTERN}(@{VERSION_PATTERN})?$"),
    Field(description="Name of a model for its newest version, or name@version."),
]

# Up to so many unknown members are named one by one; more, together.
_NAMED: Final = 20


class JsonBody(BaseModel):
    """What a request says: one with a million faults is refused at the first ones.

    pydantic makes an error of each, of a kilobyte, while no other request is answered. Lists in
    such a body are to be `FailFast` for the same reason.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    own_names: ClassVar[frozenset[str]] = frozenset()
    """Members that are called as facts are, and are none."""

    @model_validator(mode="before")
    @classmethod
    def _few_members(cls, value: Any) -> Any:
        known = len(cls.model_fields)
        if isinstance(value, dict) and len(value) > known + _NAMED:
            raise PydanticCustomError(
                "too_many_members", "at most {most} members are known", {"most": known}
            )
        return value


class Paging(BaseModel):
    """Which page of a list."""

    limit: int = Field(100, ge=1, le=1000, description="Of one page.")
    cursor: str | None = Field(None, max_length=200, description="Of the page before.")


class Paged(BaseModel):
    """A page of a list."""

    cursor: str | None = Field(description="For the next page; null on the last.")
