"""Patches of a mesh, compiled: the twin of `modes.halving`."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.codec.machine.layout import PARAMETERS
from modalmotion.numeric.machine.compiled import kernel

_VERTICES: Final = PARAMETERS
_LARGEST: Final = PARAMETERS + 1
_OFFSETS: Final = PARAMETERS + 2
_NEIGHBOURS: Final = PARAMETERS + 3
_LABEL: Final = PARAMETERS + 4
_ORDER: Final = PARAMETERS + 5
_POOL: Final = PARAMETERS + 6
_PART: Final = PARAMETERS + 7
_STARTS: Final = PARAMETERS + 8
_LABELS: Final = PARAMETERS + 9


@kernel
def _breadth_first(w: Any, first: int, new: int) -> int:
    """List what is connected and has the same label, give it a new one, and count it."""
    label, order = w[_LABEL], w[_ORDER]
    offsets, neighbours = w[_OFFSETS], w[_NEIGHBOURS]
    old = w[label + first]
    w[label + first] = new
    w[order] = first
    n, i = 1, 0
    while i < n:
        v = w[order + i]
        for at in range(neighbours + w[offsets + v], neighbours + w[offsets + v + 1]):
            u = w[at]
            if w[label + u] == old:
                w[label + u] = new
                w[order + n] = u
                n += 1
        i += 1
    return n


@kernel
def halve_parts(w: Any) -> None:
    """Label each vertex with its patch."""
    label, order, pool, part = w[_LABEL], w[_ORDER], w[_POOL], w[_PART]
    starts, labels = w[_STARTS], w[_LABELS]
    # The vertices of each part that waits, one after the other; the last is taken first.
    for v in range(w[_VERTICES]):
        w[pool + v] = v
    n_labels, n_parts, top = 1, 1, w[_VERTICES]
    while n_parts:
        n_parts -= 1
        start, this = w[starts + n_parts], w[labels + n_parts]
        size = top - start
        for i in range(size):
            w[part + i] = w[pool + start + i]
        top = start
        for i in range(size):
            first = w[part + i]
            if w[label + first] != this:
                continue
            n = _breadth_first(w, first, n_labels)
            if n > w[_LARGEST]:
                n = _breadth_first(w, w[order + n - 1], n_labels + 1)
                for place in range(n // 2, n):
                    w[label + w[order + place]] = n_labels + 2
                for half in range(n_labels + 1, n_labels + 3):
                    w[starts + n_parts] = top
                    w[labels + n_parts] = half
                    n_parts += 1
                    for j in range(i, size):
                        if w[label + w[part + j]] == half:
                            w[pool + top] = w[part + j]
                            top += 1
            n_labels += 3
