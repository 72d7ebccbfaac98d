"""Options as they stand in a query."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

Option = str | int | float | bool | Enum | tuple[float, ...] | list[float] | None
"""What an option of a call can be; None leaves it to the service."""


def query_of(options: Mapping[str, Option]) -> dict[str, str]:
    """Write options as the service reads them: 32,64 for a grid or a point, true, false."""
    return {name: _text(value) for name, value in options.items() if value is not None}


def plain(options: Mapping[str, Option]) -> dict[str, object]:
    """Write options as the members of a JSON body."""
    return {
        name: value if isinstance(value, (bool, int, float)) else _text(value)
        for name, value in options.items()
        if value is not None
    }


def _text(value: Option) -> str:
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (tuple, list)):
        return ",".join(str(part) for part in value)
    return str(value)
