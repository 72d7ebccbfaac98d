"""Edges of a mesh, its pieces, and an order in space, compiled."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from modalmotion.numeric.machine.compiled import kernel

_FEW: Final = 32
_DIGIT: Final = 11
_MASK: Final = (1 << _DIGIT) - 1


@kernel
def _sift(keys: Any, low: int, at: int, n: int) -> None:
    """Let a key sink to its place in a heap."""
    value = keys[low + at]
    child = 2 * at + 1
    while child < n:
        if child + 1 < n and keys[low + child + 1] > keys[low + child]:
            child += 1
        if keys[low + child] <= value:
            break
        keys[low + at] = keys[low + child]
        at = child
        child = 2 * at + 1
    keys[low + at] = value


@kernel
def _sort(keys: Any, low: int, high: int) -> None:
    """Sort the keys from low to high, all different, in place."""
    n = high - low
    if n <= _FEW:
        for i in range(low + 1, high):
            value = keys[i]
            j = i
            while j > low and keys[j - 1] > value:
                keys[j] = keys[j - 1]
                j -= 1
            keys[j] = value
        return
    for at in range(n // 2 - 1, -1, -1):
        _sift(keys, low, at, n)
    for last in range(n - 1, 0, -1):
        largest = keys[low]
        keys[low] = keys[low + last]
        keys[low + last] = largest
        _sift(keys, low, 0, last)


@kernel
def join_sides(
    n: int, m: int, faces: Any, first: Any, keys: Any, end: Any, count: Any, ahead: Any, edge: Any
) -> int:
    """List the edges by their smaller vertex; give their number.

    `first` comes as zeros, and leaves as the first edge of each vertex.
    """
    for f in range(3 * m):
        a, b = faces[f], faces[f + 1 if f % 3 < 2 else f - 2]
        first[min(a, b)] += 1
    total = 0
    for v in range(n):
        here = first[v]
        first[v] = total
        total += here
    for f in range(3 * m):
        a, b = faces[f], faces[f + 1 if f % 3 < 2 else f - 2]
        low, high = min(a, b), max(a, b)
        at = first[low]
        first[low] = at + 1
        keys[at] = np.int64(high) << 32 | f
    n_edges = 0
    start: Any = 0
    for v in range(n):
        stop: Any = np.int64(first[v])
        _sort(keys, start, stop)
        first[v] = n_edges
        last = -1
        for i in range(start, stop):
            other = keys[i] >> 32
            side = keys[i] & 0xFFFFFFFF
            if other != last:
                last = other
                end[n_edges] = other
                count[n_edges] = 0
                ahead[n_edges] = 0
                n_edges += 1
            e = n_edges - 1
            # Three say as much as more.
            if count[e] < 3:
                count[e] += 1
            if faces[side] == v and ahead[e] < 3:
                ahead[e] += 1
            edge[side] = e
        start = stop
    first[n] = n_edges
    return n_edges


@kernel
def name_pieces(n: int, first: Any, end: Any, name: Any) -> int:
    """Name each vertex by the smallest one of its piece; `name` comes as 0, 1, 2, ..."""
    for v in range(n):
        for e in range(first[v], first[v + 1]):
            a, b = np.int64(v), np.int64(end[e])
            while name[a] != a:
                name[a] = name[name[a]]
                a = np.int64(name[a])
            while name[b] != b:
                name[b] = name[name[b]]
                b = np.int64(name[b])
            if a < b:
                name[b] = a
            else:
                name[a] = b
    n_pieces = 0
    for v in range(n):
        # The smallest comes first, and its name is its own.
        name[v] = name[name[v]]
        if name[v] == v:
            n_pieces += 1
    return n_pieces


@kernel
def sort_codes(n: int, codes: Any, order: Any, other_codes: Any, other: Any, counts: Any) -> None:
    """Sort codes of 33 bits and what belongs to them, equals in their order, by digits of 11.

    Three times from one pair of arrays to the other: the result is in `other`. The counts,
    3 x 2048, come as zeros.
    """
    for i in range(n):
        code = codes[i]
        for digit in range(3):
            counts[(digit << _DIGIT) + ((code >> (digit * _DIGIT)) & _MASK)] += 1
    for digit in range(3):
        total = 0
        for i in range(digit << _DIGIT, (digit + 1) << _DIGIT):
            here = counts[i]
            counts[i] = total
            total += here
    for i in range(n):
        at = codes[i] & _MASK
        other_codes[counts[at]] = codes[i]
        other[counts[at]] = order[i]
        counts[at] += 1
    for i in range(n):
        at = (1 << _DIGIT) + ((other_codes[i] >> _DIGIT) & _MASK)
        codes[counts[at]] = other_codes[i]
        order[counts[at]] = other[i]
        counts[at] += 1
    for i in range(n):
        at = (2 << _DIGIT) + ((codes[i] >> (2 * _DIGIT)) & _MASK)
        other[counts[at]] = order[i]
        counts[at] += 1
