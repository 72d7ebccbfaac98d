"""On what terms a task is done: for whom, and at what price."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final


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
