"""Numbers for people, whatever their unit."""

from __future__ import annotations

from typing import Final

# Least digits that a length is worth, and how much longer a number may be than they are.
_DIGITS: Final = 3
_LONGEST: Final = 1e7

# Of the motion: what is less is the rounding of double precision.
_ROUNDING: Final = 1e-12


def numeral(value: float, decimals: int = 3, *, of: float = 0.0) -> str:
    """Write a number with fixed decimals, or with three digits where these would not show it.

    Millimetres look alike this way, and 0.3 mm in metres is 0.000288 and not 0.000.

    Parameters
    ----------
    value : float
    decimals : int
        Where three digits need no more.
    of : float
        What the number is a part of: beside it, rounding is shown as zero.
    """
    size = abs(value)
    if size <= _ROUNDING * abs(of):
        return f"{0.0:.{decimals}f}"
    if 10.0 ** (_DIGITS - 1 - decimals) <= size < _LONGEST:
        return f"{value:.{decimals}f}"
    return f"{value:#.{_DIGITS}g}"


def with_article(noun: str) -> str:
    """Write a noun with its article: a cup, an open curve."""
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def counted(n: int, noun: str, plural: str = "") -> str:
    """Write a count with its noun: 1 frame, 2 frames."""
    return f"{n} {noun if n == 1 else plural or noun + 's'}"
