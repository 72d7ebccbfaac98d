"""Kinds of plain values at the public doors: whole numbers, numbers, yes or no, one of a few words.

Python takes True for 1, cuts 2.7 to 2 and fails elsewhere with a text about types; here each is
refused by its name.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any, TypeVar

import numpy as np

from modalmotion.errors import ParameterError

Word = TypeVar("Word", bound=StrEnum)


def whole(name: str, value: Any) -> int:
    """Take a whole number, and no truth value and no fraction.

    Raises
    ------
    ParameterError
    """
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise _refusal(name, value, "a whole number", f"{name}=7")
    return int(value)


def whole_numbers(name: str, values: Any) -> tuple[int, ...]:
    """Take whole numbers, one for each axis.

    Raises
    ------
    ParameterError
    """
    if isinstance(values, str) or not np.iterable(values):
        raise _refusal(name, values, "a tuple of whole numbers", f"{name}=(32, 64)")
    numbers = list(values)
    for value in numbers:
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
            raise _refusal(name, values, "a tuple of whole numbers", f"{name}=(32, 64)")
    return tuple(map(int, numbers))


def real(name: str, value: Any) -> float:
    """Take a number, and no truth value and no text.

    Raises
    ------
    ParameterError
    """
    numbers = int | float | np.integer | np.floating
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers):
        raise _refusal(name, value, "a number", f"{name}=1.5")
    return float(value)


def truth(name: str, value: Any) -> bool:
    """Take True or False alone.

    Raises
    ------
    ParameterError
    """
    if not isinstance(value, bool | np.bool_):
        raise _refusal(name, value, "True or False", f"{name}=True")
    return bool(value)


def one_of(name: str, value: Any, words: type[Word]) -> Word:
    """Take a member of an enumeration, or its word.

    Raises
    ------
    ParameterError
    """
    try:
        return words(value)
    except ValueError:
        choice = ", ".join(words)
        raise _refusal(name, value, f"one of {choice}", f"{name}='{next(iter(words))}'") from None


def _refusal(name: str, value: Any, needed: str, example: str) -> ParameterError:
    return ParameterError(
        f"{name} is {repr(value)[:80]}, not {needed}.",
        remedy=f"Give {needed}, such as {example}.",
        details={"parameter": name},
    )
