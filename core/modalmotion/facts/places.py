"""Places on a surface: a vertex by its number, or a point."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Iterable
from typing import Any, Final, TypeAlias

from modalmotion.errors import ParameterError

Place: TypeAlias = int | tuple[float, float, float]
"""A vertex by its number, or a point in the coordinates of the reference frame."""

Corners: TypeAlias = tuple[Place, Place, Place, Place]
"""Of a plane: (s, t) = (0, 0), (1, 0), (1, 1), (0, 1), in this order."""

CORNERS: Final = "corners"
"""The landmark that is four places."""

_VERTEX: Final = re.compile(r"[0-9]{1,15}")
_LAST_VERTEX: Final = 10**15 - 1


def landmark_of(name: str, value: Any) -> Place | Corners:
    """Check a landmark: one place, or the four corners of a plane.

    Raises
    ------
    ParameterError
        If it is neither a vertex nor a point; it names the landmark.
    """
    if name != CORNERS:
        return _place(name, value)
    parts = _parts(value)
    if len(parts) != 4:
        raise ParameterError(
            f"The landmark 'corners' has {len(parts)} places, not four.",
            remedy="Give the corners at (s, t) = (0, 0), (1, 0), (1, 1), (0, 1).",
            details={"fact": "landmarks"},
        )
    a, b, c, d = (_place(name, part) for part in parts)
    return a, b, c, d


def read_place(text: str, name: str = "landmark") -> Place:
    """Read a place: the number of a vertex, or a point such as "1.5,0,-3".

    Raises
    ------
    ParameterError
        If it is neither.
    """
    if _VERTEX.fullmatch(text.strip()):
        return int(text)
    return _place(name, text.split(","))


def read_landmark(text: str, name: str) -> Place | Corners:
    """Read a landmark as `read_place` does; corners are parted by semicolons.

    Raises
    ------
    ParameterError
        If it is not a landmark.
    """
    if name != CORNERS:
        return read_place(text, name)
    return landmark_of(name, [read_place(part, name) for part in text.split(";")])


def _place(name: str, value: Any) -> Place:
    if not isinstance(value, bool | float | str):
        try:
            number = operator.index(value)
        except TypeError:
            pass
        else:
            if 0 <= number <= _LAST_VERTEX:
                return number
            raise _no_place(name)
    parts = _parts(value)
    if len(parts) != 3 or any(isinstance(part, bool) for part in parts):
        raise _no_place(name)
    try:
        x, y, z = (float(part) for part in parts)
    except (TypeError, ValueError, OverflowError):
        raise _no_place(name) from None
    if not all(map(math.isfinite, (x, y, z))):
        raise _no_place(name)
    return x, y, z


def _parts(value: Any) -> list[Any]:
    return list(value) if isinstance(value, Iterable) and not isinstance(value, str) else []


def _no_place(name: str) -> ParameterError:
    return ParameterError(
        f"The landmark '{name[:64]}' is neither a vertex nor a point.",
        remedy="Give the number of a vertex, counted from 0, or three finite coordinates x, y, z "
        "in the unit of the sequence.",
        details={"fact": "landmarks"},
    )
