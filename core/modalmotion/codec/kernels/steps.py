"""Steps from one number to the next, compiled: what `connectivity.numbering` learns from each."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.codec.connectivity.numbering import (
    FAR,
    JUST_BEFORE,
    MOST_WAYS,
    NEAR,
    RELATED_BACK,
    RELATED_STEPS,
    REMEMBERED,
)
from modalmotion.codec.connectivity.rings import NOWHERE
from modalmotion.codec.kernels.answers import place_of
from modalmotion.codec.kernels.ring_walks import (
    degree,
    follow,
    neighbour,
    path_along,
    search,
    way_back,
)
from modalmotion.codec.machine.places import (
    AROUND,
    DISTANCE,
    FREE_AT,
    NODES,
    NUMBER,
    PATHS,
    QUEUE,
    RELATED,
    RELATIONS,
    SMALL,
    STEPS,
    TAG_PAIR,
    TAG_PATH,
    TAG_STEPS,
    TURNS,
    VERTICES,
    WAY,
)
from modalmotion.numeric.machine.compiled import kernel

NODE: Final = 0
ORIGIN: Final = 1
OUTCOME: Final = 2
N_NUMBERED: Final = 3
LONE: Final = 4
LAST_PATHS: Final = 5
LAST_DISTANCES: Final = 9
"""Four each, the oldest first."""

N_PATHS: Final = 13
N_STEPS: Final = 14
MODELS: Final = 15
N_MODELS: Final = 5
"""Two numbers for the context of each model."""

LATEST_RELATIONS: Final = 26
"""Row of the latest vertex in the relations."""

STEP_WIDTH: Final = 4
"""Of what a context remembers: two paths, each with how often it came again."""

ENDS_WIDTH: Final = 1 + MOST_WAYS
RELATION_WIDTH: Final = len(RELATED_STEPS) * ENDS_WIDTH
_STEP_1, _STEP_2, _STEP_3, _STEP_4 = RELATED_STEPS
_MOST_REPEATS: Final = 5


@kernel
def row_of_relations(w: Any, back: int) -> int:
    """Where the relations of a late vertex stand: their number, then each."""
    row = (w[w[SMALL] + LATEST_RELATIONS] + back) % RELATED_BACK
    return int(w[RELATED] + row * (1 + w[RELATIONS] * RELATION_WIDTH))


@kernel
def interned(w: Any, tag: int, high: int, low: int) -> int:
    """Give a pair of numbers a number of its own, from 1."""
    at = place_of(w, tag | high << 5, low)
    if not w[at]:
        small = w[SMALL]
        w[small + N_PATHS] += 1
        number = w[small + N_PATHS]
        w[w[PATHS] + 2 * number] = high
        w[w[PATHS] + 2 * number + 1] = low
        w[at] = number
    return int(w[at])


@kernel
def follow_path(w: Any, path: int) -> int:
    """Walk along a numbered path from the latest node."""
    n = 0
    step = path
    while step > 0:
        step = w[w[PATHS] + 2 * step]
        n += 1
    i = n
    while path > 0:
        i -= 1
        w[w[TURNS] + i] = w[w[PATHS] + 2 * path + 1]
        path = w[w[PATHS] + 2 * path]
    small = w[SMALL]
    return follow(w, w[small + NODE], w[small + ORIGIN], w[TURNS], n)


@kernel
def step_of(w: Any, model: int, add: bool) -> int:
    """Where the paths that a model remembers in its context stand; -1 if there are none."""
    small = w[SMALL]
    high, low = w[small + MODELS + 2 * model], w[small + MODELS + 2 * model + 1]
    at = place_of(w, TAG_STEPS | model << 5 | high << 8, low)
    if not w[at]:
        if not add:
            return -1
        w[small + N_STEPS] += 1
        w[at] = w[small + N_STEPS]
    return int(w[STEPS] + STEP_WIDTH * w[at])


@kernel
def _remember(w: Any, model: int, path: int) -> None:
    at = step_of(w, model, True)
    if w[at] == path:
        w[at + 1] += 1
        return
    repeats = 0
    if w[at + 2] == path:
        repeats = w[at + 3] + 1
    w[at + 2] = w[at]
    w[at + 3] = w[at + 1]
    w[at] = path
    w[at + 1] = repeats


@kernel
def go_to(w: Any, node: int) -> None:
    """Give the next number to a node, and learn from its place."""
    small = w[SMALL]
    path, origin = 0, NOWHERE
    if w[small + NODE] >= 0:
        n = search(w, w[small + NODE], w[small + ORIGIN], REMEMBERED, node, FAR, -1)
        if w[w[AROUND] + n - 1] == node:
            length = way_back(w, n - 1)
            origin = w[w[WAY] + 1]
            length = path_along(w, w[small + ORIGIN], length, False)
            for i in range(length):
                path = interned(w, TAG_PATH, path, w[w[TURNS] + i])
            for model in range(N_MODELS):
                _remember(w, model, path)
    if origin == NOWHERE:
        origin = neighbour(w, node, 0)
    for i in range(3):
        w[small + LAST_PATHS + i] = w[small + LAST_PATHS + i + 1]
        w[small + LAST_DISTANCES + i] = w[small + LAST_DISTANCES + i + 1]
    w[small + LAST_PATHS + 3] = path
    w[small + LAST_DISTANCES + 3] = w[w[DISTANCE] + node]
    w[small + NODE] = node
    w[small + ORIGIN] = origin
    number_next(w, node)
    if w[RELATIONS]:
        _relate(w, node, origin)
    _spread(w, node)


@kernel
def number_next(w: Any, node: int) -> None:
    """Give the next number to a node, without relations."""
    small = w[SMALL]
    w[w[NUMBER] + node] = w[small + N_NUMBERED]
    w[w[FREE_AT] + node] = -1
    w[w[NODES] + w[small + N_NUMBERED]] = node
    w[small + N_NUMBERED] += 1
    w[small + LATEST_RELATIONS] = (w[small + LATEST_RELATIONS] + RELATED_BACK - 1) % RELATED_BACK
    w[row_of_relations(w, 0)] = 0


@kernel
def _relate(w: Any, node: int, origin: int) -> None:
    """List the ends of ways to nodes near a node, walked from nodes of neighbouring numbers."""
    row = row_of_relations(w, 0)
    # The node itself has its number by now; it is the first of the search and not near itself.
    n = w[w[SMALL] + N_NUMBERED] - 1
    n_around = search(w, node, origin, NEAR, NOWHERE, FAR, -1)
    for place in range(n_around):
        number = w[w[NUMBER] + w[w[AROUND] + place]]
        if number < 0 or number >= n - JUST_BEFORE:
            continue
        length = path_along(w, NOWHERE, way_back(w, place), True)
        relation = row + 1 + w[row] * RELATION_WIDTH
        for sign in range(4):
            step = _STEP_1
            if sign:
                step = _STEP_2 if sign == 1 else (_STEP_3 if sign == 2 else _STEP_4)
            ends = relation + sign * ENDS_WIDTH
            base = w[w[NODES] + number + step] if number + step >= 0 else NOWHERE
            n_ways = min(degree(w, base), MOST_WAYS) if base >= 0 else 0
            w[ends] = n_ways
            for i in range(n_ways):
                way = neighbour(w, base, i)
                w[ends + 1 + i] = follow(w, base, way, w[TURNS], length)
        w[row] += 1
        if w[row] == w[RELATIONS]:
            return


@kernel
def _spread(w: Any, node: int) -> None:
    """Update the distances of free nodes from numbered ones."""
    distance, queue, room = w[DISTANCE], w[QUEUE], w[VERTICES]
    w[distance + node] = 0
    w[queue] = node
    first, n = 0, 1
    while first < n:
        v = w[queue + first % room]
        first += 1
        further = w[distance + v] + 1
        if further == FAR:
            continue
        for place in range(degree(w, v)):
            there = neighbour(w, v, place)
            if w[distance + there] > further:
                w[distance + there] = further
                w[w[FREE_AT] + there] = further
                w[queue + n % room] = there
                n += 1


@kernel
def set_models(w: Any, taken: int) -> None:
    """State the contexts that the next step may depend on."""
    models, paths = w[SMALL] + MODELS, w[SMALL] + LAST_PATHS
    w[models] = 0
    w[models + 1] = w[paths + 3]
    w[models + 2] = w[paths + 2]
    w[models + 3] = w[paths + 3]
    w[models + 4] = interned(w, TAG_PAIR, w[paths], w[paths + 1])
    w[models + 5] = interned(w, TAG_PAIR, w[paths + 2], w[paths + 3])
    w[models + 6] = 0
    w[models + 7] = taken
    w[models + 8] = taken
    w[models + 9] = w[paths + 3]
