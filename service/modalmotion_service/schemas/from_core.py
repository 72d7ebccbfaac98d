"""Fields that several requests share, and models made from the library's parameter classes."""

import ast
import inspect
import re
import sys
from collections.abc import Callable, Collection
from dataclasses import MISSING, fields, is_dataclass
from functools import lru_cache
from itertools import pairwise
from types import UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Final,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    create_model,
    field_validator,
    model_validator,
)
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


class _Described(BaseModel):
    """Model with a string below each field that describes it.

    pydantic finds these strings too, by a search of all modules for every class: 0.2 s at a start.
    """

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        words = strings_of(cls.__module__).get(cls.__name__, {})
        for name, field in cls.model_fields.items():
            field.description = field.description or words.get(name)


@lru_cache
def strings_of(module: str) -> dict[str, dict[str, str]]:
    """Read the string below each field of each class of a module."""
    found: dict[str, dict[str, str]] = {}
    for one in ast.parse(inspect.getsource(sys.modules[module])).body:
        if isinstance(one, ast.ClassDef):
            words = found[one.name] = {}
            for pair in pairwise(one.body):
                match pair:
                    case ast.AnnAssign(ast.Name(name)), ast.Expr(ast.Constant(str(text))):
                        words[name] = inspect.cleandoc(text)
    return found


class Stated(_Described):
    """What the query of a request states; the router refuses names that a call does not know."""

    model_config = ConfigDict(allow_inf_nan=False)


class JsonBody(Stated):
    """What a request says: one with a million faults is refused at the first ones.

    pydantic makes an error of each, of a kilobyte, while no other request is answered. Lists in
    such a body are to be `FailFast` for the same reason.
    """

    model_config = ConfigDict(defer_build=True, extra="forbid")

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


class Paging(Stated):
    """Which page of a list."""

    limit: int = Field(100, ge=1, le=1000)
    """Of one page."""
    cursor: str | None = Field(None, max_length=200)
    """Of the page before."""


class Answer(_Described):
    """An answer; what checks it is built when it is first needed.

    Members that are answers themselves may be values of the library, and lists arrays.
    """

    model_config = ConfigDict(defer_build=True, from_attributes=True)

    @field_validator("*", mode="before")
    @classmethod
    def _as_list(cls, value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else value


class Paged(Answer):
    """A page of a list."""

    cursor: str | None
    """For the next page; null on the last."""


Body = TypeVar("Body", bound=JsonBody)
Value = TypeVar("Value")
Made = TypeVar("Made", bound=BaseModel)

_HEADING: Final = re.compile(r"^    ([a-z_0-9, ]+) : (.*)$")
_UNIT: Final = re.compile(r", (mm|s|length unit per s|bytes)(?: or None)?(?:, optional)?$")


def model_of(base: type[Body], *kinds: type, **replaced: Any) -> type[Body]:
    """Make a model with the fields of parameter classes, all of them optional.

    Parameters
    ----------
    base : type of JsonBody
        Gives the name and the documentation, what is done with the fields, and those that are other
        than the classes say.
    *kinds : dataclass
        Of several that have a field the last one counts.
    **replaced
        Fields of other types or limits than the classes say, as (type, Field(...)), and further
        ones; None for a field that is left out.
    """
    made: dict[str, Any] = {}
    for kind in kinds:
        hints, words = get_type_hints(kind), descriptions(kind)
        for one in fields(kind):
            how = replaced.get(one.name, {})
            if isinstance(how, tuple):
                made[one.name] = how
            elif how is not None and one.name not in base.model_fields:
                factory = one.default_factory
                default = "default" if factory is MISSING else "default_factory"
                stated = {default: one.default if factory is MISSING else factory, **how}
                field = Field(**stated, description=words.get(one.name))
                made[one.name] = hints[one.name], field
    more = {name: how for name, how in replaced.items() if isinstance(how, tuple)}
    return _with_fields(base, {**made, **more})


def _with_fields(base: type[Made], made: dict[str, Any]) -> type[Made]:
    model: type[Made] = create_model(
        base.__name__,
        __base__=base,
        __doc__=base.__doc__,
        __module__=base.__module__,
        **made,
    )
    return model


def value_of(body: JsonBody, kind: type[Value], **more: Any) -> Value:
    """Make the library's value of a body that has its fields.

    Raises
    ------
    InputError
        As the class does.
    """
    names = [one.name for one in fields(kind) if one.name not in more]  # type: ignore[arg-type]
    known = type(body).model_fields
    return kind(**{name: getattr(body, name) for name in names if name in known}, **more)


def mirrors(*kinds: type, without: Collection[str] = ()) -> Callable[[type[Made]], type[Made]]:
    """Give an answer the fields of classes of the library, as these describe them.

    Parameters
    ----------
    *kinds : dataclass or named tuple
    without : collection of str
        Fields that are left out. One that the answer has itself keeps its type.
    """

    def mirrored(model: type[Made]) -> type[Made]:
        made: dict[str, Any] = {}
        for kind in kinds:
            hints, documented = get_type_hints(kind), _documented(kind)
            known = fields(kind) if is_dataclass(kind) else ()
            for name in [one.name for one in known] or hints:
                heading, words = documented.get(name, ("", ""))
                own = model.model_fields.get(name)
                if name in without or (own is not None and not own.is_required()):
                    continue
                hint = _plain(hints[name], heading) if own is None else own.annotation
                said = words if own is None else own.description or words
                made[name] = hint, Field(description=said or None)
        return _with_fields(model, made)

    return mirrored


def _plain(hint: Any, heading: str) -> Any:
    """Give the type of JSON for that of a field: lists for an array of the shape in its heading."""
    if get_origin(hint) in (Union, UnionType):
        return Union[tuple(_plain(one, heading) for one in get_args(hint))]  # noqa: UP007
    if get_origin(hint) is np.ndarray:
        shape = re.search(r"\(([^)]*)\)", heading)
        hint = float
        for _ in filter(None, shape[1].replace(" ", "").split(",") if shape else ()):
            hint = list[hint]
    return hint


def read_from(model: type[Made], source: object, **more: Any) -> Made:
    """Make an answer of a value of the library, its members by their names.

    Parameters
    ----------
    model : type of BaseModel
    source : object
    **more
        Members that the value does not have, or has otherwise.
    """
    names = [one for one in model.model_fields if one not in more and hasattr(source, one)]
    return model(**{name: getattr(source, name) for name in names}, **more)


def is_listed(hint: Any) -> bool:
    """Return whether values of a type are lists."""
    if get_origin(hint) in (Union, UnionType):
        return any(map(is_listed, get_args(hint)))
    return get_origin(hint) in (tuple, list)


def descriptions(kind: type) -> dict[str, str]:
    """Read what the documentation of a class says of each parameter."""
    return {name: words for name, (_, words) in _documented(kind).items() if words}


def _documented(kind: type) -> dict[str, tuple[str, str]]:
    """Read the heading of each parameter of a class, and the words below it."""
    text = (kind.__doc__ or "").partition("Parameters\n    ----------\n")[2]
    found: dict[str, tuple[str, list[str]]] = {}
    names: list[str] = []
    for line in text.splitlines():
        if line.startswith("    ---"):
            break
        if (match := _HEADING.match(line)) is not None:
            names = match[1].split(", ")
            unit = _UNIT.search(match[2])
            for name in names:
                found[name] = match[2], [f"In {unit[1]}."] if unit else []
        elif line.startswith("        "):
            for name in names:
                found[name][1].append(line.strip())
    return {
        name: (heading, " ".join(lines).replace("`", "").replace(" None ", " null "))
        for name, (heading, lines) in found.items()
    }
