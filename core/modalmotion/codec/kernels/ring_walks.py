"""Ordered neighbours, and walks among them, compiled: the twin of `connectivity.rings`."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.codec.connectivity.rings import MOST_LOOKS, NOWHERE
from modalmotion.codec.kernels.answers import place_of
from modalmotion.codec.machine.places import (
    AFTER,
    AROUND,
    BACK,
    DISTANCE,
    ENTERED,
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
from modalmotion.numeric.machine.compiled import kernel

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
    for v in range(n):
        for entry in range(w[w[RING] + v], w[w[RING] + v + 1]):
            w[w[BACK] + entry] = place_in(w, w[w[RINGS] + entry], v)


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
    ring = w[RING] + v
    begin = w[ring]
    n = w[ring + 1] - begin
    if n > _SCANNED:
        return int(w[place_of(w, TAG_RING | v << 5, x)] - 1)
    first = w[RINGS] + begin
    for place in range(n):
        if w[first + place] == x:
            return place
    return -1


@kernel
def follow(w: Any, node: int, origin: int, turns: int, n_turns: int) -> int:
    """Walk along turns; `NOWHERE` where a node has too few neighbours."""
    ring, rings, back = w[RING], w[RINGS], w[BACK]
    place = place_in(w, node, origin) if n_turns else 0
    for i in range(n_turns):
        turn = w[turns + i]
        begin = w[ring + node]
        n = w[ring + node + 1] - begin
        if turn >= n:
            return NOWHERE
        place += 1 + turn
        entry = begin + (place if place < n else place - n)
        node = w[rings + entry]
        place = w[back + entry]
    return node


@kernel
def search(w: Any, node: int, origin: int, most: int, goal: int, distance: int, rank: int) -> int:
    """List the nodes around a node, near ones first, up to a goal; give their number.

    With a rank, the goal is the node that so many of the same distance come before, and what is
    given is 0 where there is none.
    """
    w[N_STAMPS] += 1
    mark, stamp = w[N_STAMPS], w[STAMP]
    nodes, parents, ring, rings = w[AROUND], w[PARENTS], w[RING], w[RINGS]
    entered, back, distances = w[ENTERED], w[BACK], w[DISTANCE]
    w[entered] = place_in(w, node, origin)
    w[nodes] = node
    w[parents] = -1
    w[stamp + node] = mark
    n = 1
    looks = MOST_LOOKS * most
    parent = 0
    while parent < n:
        here = w[nodes + parent]
        begin = w[ring + here]
        size = w[ring + here + 1] - begin
        # A hub has more neighbours than there is time for.
        looks -= size
        if looks <= 0:
            break
        place = w[entered + parent]
        for _ in range(size):
            place = place + 1 if place + 1 < size else 0
            there = w[rings + begin + place]
            if w[stamp + there] != mark:
                w[stamp + there] = mark
                w[nodes + n] = there
                w[parents + n] = parent
                w[entered + n] = w[back + begin + place]
                n += 1
                if rank >= 0 and w[distances + there] == distance:
                    if rank == 0:
                        return n
                    rank -= 1
                if there == goal or n > most:
                    return 0 if rank >= 0 else n
        parent += 1
    return 0 if rank >= 0 else n


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
