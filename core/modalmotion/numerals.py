"""Numbers for people, in any unit."""

from __future__ import annotations

from typing import Final

# Significant digits of very small and very large numbers, and where the large ones begin.
_DIGITS: Final = 3
_LONGEST: Final = 1e7

# Share of `of`; a smaller number is the rounding of double precision.
_ROUNDING: Final = 1e-12


def numeral(value: float, decimals: int = 3, *, of: float = 0.0) -> str:
    """Write a number with fixed decimals, or with three digits where these would not show it.

    Millimetres look alike this way, and 0.3 mm in metres is 0.000288 and not 0.000.

    Parameters
    ----------
    value : float
    decimals : int
        Unless three digits need more.
    of : float
        Size that the number is a part of: its rounding is shown as zero.
    """
    size = abs(value)
    if size <= _ROUNDING * abs(of):
        return f"{0.0:.{decimals}f}"
    if 10.0 ** (_DIGITS - 1 - decimals) <= size < _LONGEST:
        return f"{value:.{decimals}f}"
    return f"{value:#.{_DIGITS}g}"


def with_interval(value: float, low: float, high: float) -> tuple[str, str]:
    """Write a number and its interval, with one decimal, or as many as tell its ends apart.

    Two at most: an interval that is narrower is said to be.

    Examples
    --------
    >>> with_interval(62.14, 60.9, 63.4)
    ('62.1', '60.9 to 63.4')
    >>> with_interval(179.031, 179.011, 179.043)
    ('179.03', '179.01 to 179.04')
    """
    for decimals in (1, 2):
        texts = [f"{x:.{decimals}f}" for x in (value, low, high)]
        if texts[1] != texts[2]:
            return texts[0], f"{texts[1]} to {texts[2]}"
    return f"{value:.2f}", "± less than 0.01"


def probability(value: float) -> str:
    """Write the probability of an answer, never as certain: "0.87", "> 0.99"."""
    return "> 0.99" if value > 0.99 else f"{value:.2f}"


def with_article(noun: str) -> str:
    """Write a noun with its article: a cup, an open curve."""
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def counted(n: int, noun: str, plural: str = "") -> str:
    """Write a count with its noun: 1 frame, 2 frames."""
    return f"{n} {noun if n == 1 else plural or noun + 's'}"
