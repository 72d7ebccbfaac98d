"""The unit of drawn lengths; beyond the range of axes a power of ten of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_SMALLEST: Final = 1e-9
_LARGEST: Final = 1e9


@dataclass(frozen=True)
class ShownUnit:
    """The unit of a picture's axes.

    Parameters
    ----------
    size : float
        Divisor of lengths before drawing.
    name : str
    """

    size: float
    name: str


def shown_unit(largest: float, unit: str | None) -> ShownUnit:
    """Choose it for the largest length in a picture.

    Parameters
    ----------
    largest : float, `unit`
    unit : str or None
    """
    name = unit or "length units"
    if largest == 0.0 or _SMALLEST <= largest <= _LARGEST:
        return ShownUnit(1.0, name)
    power = math.floor(math.log10(largest))
    return ShownUnit(10.0**power, f"1e{power} {name}")
