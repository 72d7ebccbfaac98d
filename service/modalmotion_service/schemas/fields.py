"""Names, shapes, landmarks and times as they stand in a query."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from modalmotion.errors import ParameterError
from modalmotion.facts import Place
from modalmotion.facts.places import read_place

GRID_PATTERN: Final = r"^[1-9][0-9]{0,8}(,[1-9][0-9]{0,8}){0,2}$"


_NUMBER: Final = r"[+-]?[0-9]{1,15}([.][0-9]{0,20})?(e[+-]?[0-9]{1,3})?"


PLACE: Final[Any] = Field(
    None,
    pattern=f"^([0-9]{{1,9}}|{_NUMBER},{_NUMBER},{_NUMBER})$",
    description="Landmark: the number of a vertex, or a point as x,y,z.",
)


POINT: Final[Any] = Field(
    None,
    pattern=f"^{_NUMBER},{_NUMBER},{_NUMBER}$",
    description="Landmark in the reference frame, x,y,z in the unit of the points.",
)


TOPOLOGY: Final[Any] = Field(
    None,
    max_length=80,
    description="cup, cylinder, plane, torus, sphere, open curve or closed curve; overrides "
    "the file's.",
)


GRID: Final[Any] = Field(
    None, pattern=GRID_PATTERN, description="Nodes along each axis of a lattice, such as 32,64."
)


JobId = Annotated[str, StringConstraints(pattern="^[0-9a-f]{32}$")]


SequenceId = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]


# Up to so many unknown members are named one by one; more, together.
_NAMED: Final = 20


class JsonBody(BaseModel):
    """A JSON body: one with a million faults is refused at the first ones.

    pydantic makes an error of each, of a kilobyte, while no other request is answered. Lists in
    such a body are to be `FailFast` for the same reason.
    """

    model_config = ConfigDict(extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _few_members(cls, value: Any) -> Any:
        known = len(cls.model_fields)
        if isinstance(value, dict) and len(value) > known + _NAMED:
            raise PydanticCustomError(
                "too_many_members", "at most {most} members are known", {"most": known}
            )
        return value


def parse_place(text: str | None) -> Place | None:
    """Read a landmark: the number of a vertex, or a point such as "1.5,0,-3"."""
    return None if text is None else read_place(text)


def parse_times(text: str) -> list[float]:
    """Read times such as "0,0.1,0.25".

    Raises
    ------
    ParameterError
        If one of them is not a number.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ParameterError(
            f"The times {text[:60]!r} are not all numbers.", remedy="Write them as 0,0.1,0.25."
        ) from None


def _reference(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    # Of a union pydantic says what is wrong with each member, and not what is wanted.
    try:
        return handler(value)
    except ValidationError as error:
        raise PydanticCustomError(
            "reference", "Input should be a frame, counted from 0, or 'mean'"
        ) from error


ReferenceShape = Annotated[Annotated[int, Field(ge=0)] | Literal["mean"], WrapValidator(_reference)]
"""Shape that displacements are measured from."""


def parse_grid(text: str | None) -> tuple[int, ...] | None:
    """Read a lattice shape such as "32,64"."""
    return None if text is None else tuple(int(n) for n in text.split(","))
