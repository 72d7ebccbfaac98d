"""Groups of features, by names that people use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

# First words of the columns about an axis.
_ABOUT_AXIS: Final = {
    "radial": "contraction",
    "turning": "twist",
    "axial": "shortening",
    "across": "bending",
    "tilt": "bending",
    "oval": "oval shape",
    "side": "one side against the other",
    "lobe": "lobes",
}
_TOGETHER: Final = "how the waves go together"


def group_of(column: str) -> str:
    """Give the group of a column, by its name.

    Modes as they are have a group for each wave over the surface; what relates several is one
    of its own.
    """
    first = column.split(" ", 1)[0]
    if first in _ABOUT_AXIS:
        return _ABOUT_AXIS[first]
    if column.startswith("size (") and column.count("(") == 1:
        return f"wave {column[column.index('(') : column.index(')') + 1]}"
    if first == "motion":
        return "amount of motion"
    return _TOGETHER


def groups_of(columns: Sequence[str]) -> dict[str, list[int]]:
    """Give the indices of the columns of each group, in their order."""
    groups: dict[str, list[int]] = {}
    for k, column in enumerate(columns):
        groups.setdefault(group_of(column), []).append(k)
    return groups
