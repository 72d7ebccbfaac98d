"""Models of requests made from the library's parameter classes: their fields, types and words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import MISSING, fields
from functools import partial
from types import UnionType
from typing import Any, Final, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import Field, create_model

from modalmotion_service.schemas.fields import JsonBody

Body = TypeVar("Body", bound=JsonBody)
Value = TypeVar("Value")

_HEADING: Final = re.compile(r"^    ([a-z_0-9, ]+) : (.*)$")


def model_of(base: type[Body], *kinds: type, **replaced: Any) -> type[Body]:
    """Make a model with the fields of parameter classes, all of them optional.

    Parameters
    ----------
    base : type of JsonBody
        Gives the name and the documentation, and what is done with the fields.
    *kinds : dataclass
        Of several that have a field the last one counts.
    **replaced
        Fields of other types or limits than the classes say, as (type, Field(...)), and further
        ones; None for a field that is left out.
    """
    known: dict[str, Any] = {}
    for kind in kinds:
        hints, words = get_type_hints(kind), descriptions(kind)
        for one in fields(kind):
            made = one.default_factory
            default = {"default": one.default} if made is MISSING else {"default_factory": made}
            known[one.name] = (
                hints[one.name],
                partial(Field, **default, description=words.get(one.name)),
            )
    for name, how in replaced.items():
        if how is None:
            known.pop(name, None)
        elif isinstance(how, Mapping):
            hint, make = known[name]
            known[name] = hint, partial(make, **how)
        else:
            known[name] = how
    made_fields = {
        name: (hint, field() if isinstance(field, partial) else field)
        for name, (hint, field) in known.items()
    }
    model: type[Body] = create_model(  # type: ignore[call-overload]
        base.__name__,
        __base__=base,
        __doc__=base.__doc__,
        __module__=base.__module__,
        **made_fields,
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


def is_listed(hint: Any) -> bool:
    """Tell whether values of a type are lists."""
    if get_origin(hint) in (Union, UnionType):
        return any(map(is_listed, get_args(hint)))
    return get_origin(hint) in (tuple, list)


def descriptions(kind: type) -> dict[str, str]:
    """Read what the documentation of a class says of each parameter."""
    text = (kind.__doc__ or "").partition("Parameters\n    ----------\n")[2]
    found: dict[str, list[str]] = {}
    names: list[str] = []
    for line in text.splitlines():
        if line.startswith("    ---"):
            break
        if (match := _HEADING.match(line)) is not None:
            names = match[1].split(", ")
            unit = re.search(
                r", (mm|s|length unit per s|bytes)(?: or None)?(?:, optional)?$", match[2]
            )
            found |= {name: [f"In {unit[1]}."] if unit else [] for name in names}
        elif line.startswith("        "):
            for name in names:
                found[name].append(line.strip())
    return {
        name: " ".join(lines).replace("`", "").replace(" None ", " null ")
        for name, lines in found.items()
        if lines
    }
