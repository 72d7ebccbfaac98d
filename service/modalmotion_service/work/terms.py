"""On what terms a task is done: for whom, and at what price."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import Final

_PREFIX: Final = 8


@dataclass(frozen=True)
class Terms:
    """On what terms a task is done.

    Parameters
    ----------
    owner : str
        Whose turn it takes.
    price : float, s
        Processor time that an honest file of its size takes; infinite where nobody knows.
    most_seconds : float, s
        Processor time after which it is ended.
    """

    owner: str = ""
    price: float = math.inf
    most_seconds: float = math.inf


NO_TERMS: Final = Terms()
"""Of work of the service's own, which no owner asked for."""


def with_terms(terms: Terms, payload: bytes) -> bytes:
    """Write the terms of a task before it."""
    text = json.dumps(asdict(terms)).encode()
    return len(text).to_bytes(_PREFIX, "little") + text + payload


def read_terms(data: bytes) -> tuple[Terms, bytes]:
    """Read what `with_terms` wrote."""
    end = _PREFIX + int.from_bytes(data[:_PREFIX], "little")
    return Terms(**json.loads(data[_PREFIX:end])), data[end:]
