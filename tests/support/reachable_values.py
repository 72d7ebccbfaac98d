"""Every value of the library that can be reached from some, through public attributes."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

from modalmotion.errors import InputError

_OPEN_TO_ALL = (tuple, list, dict)
_ENOUGH = 40


def reachable_values(starts: Iterable[Any]) -> Iterator[Any]:
    """Yield values of classes of this library; what a property refuses is passed over.

    Of a class whose properties make its like anew, without end, the first few dozen are enough.
    """
    seen: dict[int, Any] = {}
    counts: Counter[type] = Counter()
    waiting = list(starts)
    while waiting:
        value = waiting.pop()
        is_ours = type(value).__module__.startswith("modalmotion")
        if id(value) in seen or not (is_ours or isinstance(value, _OPEN_TO_ALL)):
            continue
        seen[id(value)] = value
        counts[type(value)] += is_ours
        if is_ours and counts[type(value)] <= _ENOUGH:
            yield value
            waiting += [_attribute(value, name) for name in dir(value) if name[:1] != "_"]
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, _OPEN_TO_ALL):
            waiting += value


def _attribute(value: Any, name: str) -> Any:
    # What a class hands out as a function is called by nobody here.
    if callable(getattr(type(value), name, None)):
        return None
    with contextlib.suppress(InputError):
        return getattr(value, name)
    return None
