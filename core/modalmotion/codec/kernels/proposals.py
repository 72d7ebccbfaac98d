"""Proposals of the next node, and how far their sources are trusted, compiled."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from modalmotion.codec.connectivity.numbering import LOGARITHMS, MOST_TRUSTED, RELATED_BACK
from modalmotion.codec.connectivity.rings import NOWHERE
from modalmotion.codec.kernels.ring_walks import degree, neighbour, place_in
from modalmotion.codec.kernels.steps import (
    ENDS_WIDTH,
    N_MODELS,
    NODE,
    ORIGIN,
    RELATION_WIDTH,
    follow_path,
    interned,
    row_of_relations,
    set_models,
    step_of,
)
from modalmotion.codec.machine.places import (
    NUMBER,
    PROPOSED,
    SLOT,
    SMALL,
    SOURCES,
    TAG_TAKEN,
    TRUST,
)
from modalmotion.numeric.machine.compiled import kernel

_LOGARITHMS: Final = np.array(LOGARITHMS, dtype=np.int64)
PROPOSED_NODE, FIRST_SOURCE, LAST_SOURCE, N_SOURCES, TOTAL = range(5)
PROPOSED_WIDTH: Final = 5
SOURCE_WIDTH: Final = 2
"""A source, and the next one of the same node."""

N_PROPOSED_SO_FAR: Final = 27
N_SOURCES_SO_FAR: Final = 28

_MOST_REPEATS: Final = 5
_MOST_TURN: Final = 5
_FIRST_RELATED: Final = N_MODELS * 2 * (_MOST_REPEATS + 1)
_MOST_RELATED: Final = 4 * RELATED_BACK * 8
FIRST_NEIGHBOUR: Final = _FIRST_RELATED + _MOST_RELATED
"""Numbers of sources: models, then relations, then neighbours by turn and size of the ring."""


@kernel
def short_of(source: int) -> int:
    """Give the first two numbers of a source."""
    if source < _FIRST_RELATED:
        return source // (_MOST_REPEATS + 1)
    if source < FIRST_NEIGHBOUR:
        return source
    return FIRST_NEIGHBOUR + (source - FIRST_NEIGHBOUR) % (_MOST_TURN + 1)


@kernel
def trust_of(w: Any, source: int) -> int:
    """1024 times the logarithm of 1 / its share of wrong proposals."""
    counts = w[w[TRUST] + source]
    if not counts:
        return int(_LOGARITHMS[2])
    right, wrong = counts >> 8, counts & 255
    return int(_LOGARITHMS[right + wrong] - _LOGARITHMS[wrong])


@kernel
def _propose(w: Any, node: int, source: int, trust: int) -> None:
    """Note a free node and the source that proposes it."""
    # What is written may be anything to the compiler: places are looked up once, and first.
    small, sources, slots, proposed = w[SMALL], w[SOURCES], w[SLOT], w[PROPOSED]
    entry, n, number = w[small + N_SOURCES_SO_FAR], w[small + N_PROPOSED_SO_FAR], w[slots + node]
    at = proposed + PROPOSED_WIDTH * number
    is_new = number >= n or w[at + PROPOSED_NODE] != node
    w[small + N_SOURCES_SO_FAR] = entry + 1
    here = sources + SOURCE_WIDTH * entry
    w[here] = source
    w[here + 1] = -1
    if is_new:
        w[slots + node] = n
        at = proposed + PROPOSED_WIDTH * n
        w[small + N_PROPOSED_SO_FAR] = n + 1
        w[at + PROPOSED_NODE] = node
        w[at + FIRST_SOURCE] = entry
        w[at + LAST_SOURCE] = entry
        w[at + N_SOURCES] = 1
        w[at + TOTAL] = trust
    else:
        last, count, total = w[at + LAST_SOURCE], w[at + N_SOURCES], w[at + TOTAL]
        w[sources + SOURCE_WIDTH * last + 1] = entry
        w[at + LAST_SOURCE] = entry
        w[at + N_SOURCES] = count + 1
        w[at + TOTAL] = total + trust


@kernel
def list_proposals(w: Any) -> int:
    """List free nodes and the sources that propose each; give the number of nodes."""
    small = w[SMALL]
    w[small + N_PROPOSED_SO_FAR] = 0
    w[small + N_SOURCES_SO_FAR] = 0
    node, origin, numbers = w[small + NODE], w[small + ORIGIN], w[NUMBER]
    if node < 0:
        return 0
    n_around = degree(w, node)
    start = place_in(w, node, origin) + 1
    taken = 0
    for turn in range(n_around):
        there = neighbour(w, node, (start + turn) % n_around)
        taken = interned(w, TAG_TAKEN, taken, 1 if w[w[NUMBER] + there] >= 0 else 0)
    set_models(w, taken)
    for model in range(N_MODELS):
        at = step_of(w, model, False)
        for place in range(2):
            if at >= 0 and w[at + 2 * place]:
                repeats = min(w[at + 2 * place + 1], _MOST_REPEATS)
                source = (2 * model + place) * (_MOST_REPEATS + 1) + repeats
                there = follow_path(w, w[at + 2 * place])
                if there != NOWHERE and w[numbers + there] < 0:
                    _propose(w, there, source, trust_of(w, source))
    for turn in range(n_around):
        there = neighbour(w, node, (start + turn) % n_around)
        source = FIRST_NEIGHBOUR + (_MOST_TURN + 1) * n_around + min(turn, _MOST_TURN)
        if w[numbers + there] < 0:
            _propose(w, there, source, trust_of(w, source))
    for back in range(RELATED_BACK):
        row = row_of_relations(w, back)
        for place in range(w[row]):
            relation = row + 1 + place * RELATION_WIDTH
            for sign in range(4):
                ends = relation + sign * ENDS_WIDTH
                source = _FIRST_RELATED + (4 * back + sign) * 8 + place
                trust = trust_of(w, source)
                for i in range(w[ends]):
                    there = w[ends + 1 + i]
                    if there != NOWHERE and w[numbers + there] < 0:
                        _propose(w, there, source, trust)
    return int(w[small + N_PROPOSED_SO_FAR])


@kernel
def judge(w: Any, n_proposed: int, node: int) -> None:
    """Count for every source of every proposal whether it was right."""
    proposed, sources, trusted = w[PROPOSED], w[SOURCES], w[TRUST]
    for proposal in range(n_proposed):
        at = proposed + PROPOSED_WIDTH * proposal
        is_right = w[at + PROPOSED_NODE] == node
        entry = w[at + FIRST_SOURCE]
        while entry >= 0:
            here = sources + SOURCE_WIDTH * entry
            trust = trusted + w[here]
            counts = w[trust]
            right = counts >> 8 if counts else 1
            wrong = counts & 255 if counts else 1
            if is_right:
                right += 1
            else:
                wrong += 1
            if right + wrong > MOST_TRUSTED:
                right = (right + 1) // 2
                wrong = (wrong + 1) // 2
            w[trust] = right << 8 | wrong
            entry = w[here + 1]
