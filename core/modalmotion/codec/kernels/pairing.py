"""Pairs of neighbours, compiled: the twin of a step of `modes.pairs`."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.codec.machine.layout import PARAMETERS
from modalmotion.numeric.machine.compiled import kernel

_NODES: Final = PARAMETERS
_OFFSETS: Final = PARAMETERS + 2
_NEIGHBOURS: Final = PARAMETERS + 3
_WEIGHT: Final = PARAMETERS + 4
_MATE: Final = PARAMETERS + 5


@kernel
def pair_nodes(w: Any) -> None:
    """Give each node a mate, itself where no neighbour is free."""
    offsets, neighbours = w[_OFFSETS], w[_NEIGHBOURS]
    weight, mate = w[_WEIGHT], w[_MATE]
    n = w[_NODES]
    for u in range(n):
        w[mate + u] = -1
    for u in range(n):
        if w[mate + u] >= 0:
            continue
        found = u
        least = -1
        for at in range(neighbours + w[offsets + u], neighbours + w[offsets + u + 1]):
            v = w[at]
            if w[mate + v] < 0 and (least < 0 or w[weight + v] < least):
                found = v
                least = w[weight + v]
        w[mate + u] = found
        w[mate + found] = u
