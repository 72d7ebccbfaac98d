"""Ordered neighbours, and walks among them, compiled: the twin of `connectivity.rings`."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.codec.connectivity.rings import MOST_LOOKS, NOWHERE
from modalmotion.codec.kernels.answers import place_of
from modalmotion.codec.kernels.compiled import kernel
from modalmotion.codec.machine.places import (
    AFTER,
    AROUND,
    FACES,
    FIRST_PAIR,
    HAS_AFTER,
    HAS_BEFORE,
    IN_RING,
    MET,
    N_STAMPS,
    PAIRS,
    PARENTS,
    RING,
    RINGS,
    SEEN,
    STAMP,
    TAG_RING,
    TURNS,
    VERTICES,
    WAY,
)

_SCANNED: Final = 16


@kernel
def make_rings(w: Any) -> None:
    """Put the neighbours of each node in order."""
    n, first = w[VERTICES], w[FIRST_PAIR]
    for corner in range(3 * w[FACES]):
        w[first + w[w[MET] + corner] + 1] += 1
    for v in range(n):
        w[first + v + 1] += w[first + v]
    # The first of a node is used as its cursor, and put back by the next one's.
    for corner in range(3 * w[FACES]):
        face = w[MET] + corner // 3 * 3
        v = w[w[MET] + corner]
        pair = w[PAIRS] + 2 * w[first + v]
        w[pair] = w[face + (corner + 1) % 3]
        w[pair + 1] = w[face + (corner + 2) % 3]
        w[first + v] += 1
    start = end = 0
    for v in range(n):
        start, end = end, w[first + v]
        _make_ring(w, v, start, end)


@kernel
def _make_ring(w: Any, v: int, start: int, end: int) -> None:
    mark = v + 1
    neighbours = w[WAY]
    n = 0
    for pair in range(start, end):
        x, y = w[w[PAIRS] + 2 * pair], w[w[PAIRS] + 2 * pair + 1]
        if w[w[SEEN] + x] != mark:
            w[w[SEEN] + x] = mark
            w[neighbours + n] = x
            n += 1
        if w[w[SEEN] + y] != mark:
            w[w[SEEN] + y] = mark
            w[neighbours + n] = y
            n += 1
        if w[w[HAS_AFTER] + x] != mark and w[w[HAS_BEFORE] + y] != mark:
            w[w[HAS_AFTER] + x] = mark
            w[w[HAS_BEFORE] + y] = mark
            w[w[AFTER] + x] = y
    begin = w[w[RING] + v]
    w[w[RING] + v + 1] = begin + n
    place = 0
    # Chains begin at a border; what is left are closed rings.
    for turn in range(2):
        for i in range(n):
            x = w[neighbours + i]
            if turn == 0 and w[w[HAS_BEFORE] + x] == mark:
                continue
            while w[w[IN_RING] + x] != mark:
                w[w[IN_RING] + x] = mark
                w[w[RINGS] + begin + place] = x
                place += 1
                if n > _SCANNED:
                    w[place_of(w, TAG_RING | v << 5, x)] = place
                if w[w[HAS_AFTER] + x] != mark:
                    break
                x = w[w[AFTER] + x]


@kernel
def degree(w: Any, v: int) -> int:
    """Count the neighbours."""
    return int(w[w[RING] + v + 1] - w[w[RING] + v])


@kernel
def neighbour(w: Any, v: int, place: int) -> int:
    """Give the neighbour at a place of the ring."""
    return int(w[w[RINGS] + w[w[RING] + v] + place])


@kernel
def place_in(w: Any, v: int, x: int) -> int:
    """Place of a node in the ring of another, or -1."""
    if x < 0:
        return -1
    n = degree(w, v)
    if n > _SCANNED:
        return int(w[place_of(w, TAG_RING | v << 5, x)] - 1)
    first = w[RINGS] + w[w[RING] + v]
    for place in range(n):
        if w[first + place] == x:
            return place
    return -1


@kernel
def follow(w: Any, node: int, origin: int, turns: int, n_turns: int) -> int:
    """Walk along turns; `NOWHERE` where a node has too few neighbours."""
    for i in range(n_turns):
        turn = w[turns + i]
        n = degree(w, node)
        if turn >= n:
            return NOWHERE
        place = place_in(w, node, origin) + 1 + turn
        origin = node
        node = neighbour(w, node, place if place < n else place - n)
    return node


@kernel
def search(w: Any, node: int, origin: int, most: int, goal: int) -> int:
    """List the nodes around a node, near ones first; give their number."""
    w[N_STAMPS] += 1
    mark, stamp = w[N_STAMPS], w[STAMP]
    nodes, parents = w[AROUND], w[PARENTS]
    w[nodes] = node
    w[parents] = -1
    w[stamp + node] = mark
    n = 1
    looks = MOST_LOOKS * most
    parent = 0
    while parent < n:
        here = w[nodes + parent]
        before = origin if parent == 0 else w[nodes + w[parents + parent]]
        size = degree(w, here)
        # A hub has more neighbours than there is time for.
        looks -= size
        if looks <= 0:
            break
        place = place_in(w, here, before)
        for _ in range(size):
            place = place + 1 if place + 1 < size else 0
            there = neighbour(w, here, place)
            if w[stamp + there] != mark:
                w[stamp + there] = mark
                w[nodes + n] = there
                w[parents + n] = parent
                n += 1
                if there == goal or n > most:
                    return n
        parent += 1
    return n


@kernel
def way_back(w: Any, place: int) -> int:
    """Put the nodes from a place of the search to its first into `WAY`; give their number."""
    n = 0
    while place >= 0:
        w[w[WAY] + n] = w[w[AROUND] + place]
        place = w[w[PARENTS] + place]
        n += 1
    return n


@kernel
def path_along(w: Any, origin: int, n: int, is_back: bool) -> int:
    """Put the turns along `WAY`, or along it backwards, into `TURNS`; give their number."""
    for i in range(n - 1):
        here = w[w[WAY] + (i if is_back else n - 1 - i)]
        there = w[w[WAY] + (i + 1 if is_back else n - 2 - i)]
        turn = place_in(w, here, there) - place_in(w, here, origin) - 1
        w[w[TURNS] + i] = turn if turn >= 0 else turn + degree(w, here)
        origin = here
    return n - 1
