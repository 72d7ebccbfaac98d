"""Options written as a query."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from enum import Enum
from typing import Any, Final

from modalmotion.errors import ParameterError
from modalmotion.facts import Facts, facts_as_json

Option = str | int | float | bool | Enum | tuple[float, ...] | list[float] | Facts | None
"""What an option of a call can be; None leaves it to the service. Facts are several at once."""

# Neither a separator, nor the end of a path, nor a name such as "..".
_SEGMENT: Final = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,199}")


def segment(name: str) -> str:
    """Check an id that becomes part of a path: it names one thing, and leads nowhere else.

    Raises
    ------
    ParameterError
        If it cannot be one.
    """
    if _SEGMENT.fullmatch(name) is None:
        raise ParameterError(
            f"{name[:80]!r} cannot be an id.", remedy="Use one that the service has given."
        )
    return name


def query_of(options: Mapping[str, Option]) -> dict[str, str]:
    """Write options as the service reads them: 32,64 for a grid or a point, true, false."""
    query: dict[str, str] = {}
    for name, value in options.items():
        if isinstance(value, Facts):
            query |= {fact: _text(said) for fact, said in stated_in(value).items()}
        elif value is not None:
            query[name] = _text(value)
    return query


def stated_in(facts: Facts) -> dict[str, Any]:
    """Facts that are not unknown, ready for JSON."""
    values = facts_as_json(facts)
    return {name: values[name] for name in facts.stated}


def plain(options: Mapping[str, Option]) -> dict[str, object]:
    """Write options as the members of a JSON body."""
    return {
        name: value if isinstance(value, (bool, int, float)) else _text(value)
        for name, value in options.items()
        if value is not None
    }


def _text(value: Option | dict[str, Any]) -> str:
    if isinstance(value, dict):
        return json.dumps(value)
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (tuple, list)):
        return ",".join(str(part) for part in value)
    return str(value)
