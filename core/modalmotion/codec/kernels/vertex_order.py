"""The order of the vertices, compiled: the twin of `connectivity.numbering`."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.codec.connectivity.numbering import (
    FAR,
    LARGEST_RANKED,
    LIKE_THE_LAST,
    N_PROPOSED,
    SEARCHED,
)
from modalmotion.codec.connectivity.rings import NOWHERE
from modalmotion.codec.kernels.answers import ask, code_number, set_context
from modalmotion.codec.kernels.coding import code_bits, fail
from modalmotion.codec.kernels.proposals import (
    FIRST_SOURCE,
    N_SOURCES,
    PROPOSED_NODE,
    PROPOSED_WIDTH,
    SOURCE_WIDTH,
    TOTAL,
    judge,
    list_proposals,
    short_of,
    trust_of,
)
from modalmotion.codec.kernels.ring_walks import degree, search
from modalmotion.codec.kernels.steps import (
    LAST_DISTANCES,
    LONE,
    NODE,
    ORIGIN,
    OUTCOME,
    go_to,
    number_next,
)
from modalmotion.codec.machine.layout import NO_NODE, READS, STATUS
from modalmotion.codec.machine.places import (
    AROUND,
    DISTANCE,
    FREE_AT,
    PROPOSED,
    SMALL,
    SOURCES,
    VERTICES,
)
from modalmotion.numeric.machine.compiled import kernel

_LONE, _HERE, _DISTANCE, _FAR, _RANK = 13, 14, 18, 19, 20
_CHOSEN: Final = 64
"""Where in the short lists the likeliest proposals stand."""


@kernel
def code_vertex(w: Any, words: Any, bits: Any, node: int) -> int:
    """Code which node has the next number."""
    small = w[SMALL]
    n = w[VERTICES]
    while w[small + LONE] < n and degree(w, w[small + LONE]) > 0:
        w[small + LONE] += 1
    if w[small + LONE] < n:
        set_context(w, 0, 0, 0)
        alone = 0 if w[READS] else (1 if node >= n or degree(w, node) == 0 else 0)
        if ask(w, words, _LONE, 0, 1, alone):
            node = w[small + LONE]
            w[small + LONE] += 1
            number_next(w, node)
            return node
    n_proposed = list_proposals(w)
    n_likeliest = _choose_likeliest(w, n_proposed)
    found = NOWHERE
    for place in range(n_likeliest):
        proposal = w[small + _CHOSEN + place]
        candidate = w[w[PROPOSED] + PROPOSED_WIDTH * proposal + PROPOSED_NODE]
        _set_contexts(w, place, proposal)
        if ask(w, words, _HERE + min(place, 3), 0, 5, 1 if candidate == node else 0):
            found = candidate
            w[small + OUTCOME] = place
            break
    if found == NOWHERE:
        w[small + OUTCOME] = N_PROPOSED
        found = _find(w, words, bits, node, n_likeliest)
        if found == NOWHERE or w[STATUS]:
            fail(w, NO_NODE)
            return NOWHERE
    judge(w, n_proposed, found)
    go_to(w, found)
    return found


@kernel
def _choose_likeliest(w: Any, n_proposed: int) -> int:
    """List the most trusted proposals, the most trusted first, ties as they came."""
    chosen = w[SMALL] + _CHOSEN
    strengths = chosen + N_PROPOSED + 1
    alike = w[w[SMALL] + LAST_DISTANCES + 3]
    proposed, distances = w[PROPOSED], w[DISTANCE]
    n, weakest = 0, -1
    for proposal in range(n_proposed):
        at = proposed + PROPOSED_WIDTH * proposal
        strength = w[at + TOTAL]
        if w[distances + w[at + PROPOSED_NODE]] == alike:
            strength += LIKE_THE_LAST
        if n == N_PROPOSED and strength <= weakest:
            continue
        place = n
        while place > 0 and w[strengths + place - 1] < strength:
            w[strengths + place] = w[strengths + place - 1]
            w[chosen + place] = w[chosen + place - 1]
            place -= 1
        if place < N_PROPOSED:
            w[strengths + place] = strength
            w[chosen + place] = proposal
            n = min(n + 1, N_PROPOSED)
            weakest = w[strengths + n - 1]
    return n


@kernel
def _set_contexts(w: Any, place: int, proposal: int) -> None:
    at = w[PROPOSED] + PROPOSED_WIDTH * proposal
    last = w[SMALL] + LAST_DISTANCES
    strength = min(15, 3 * w[at + TOTAL] // 1024)
    distance = w[w[DISTANCE] + w[at + PROPOSED_NODE]]
    best, most = 0, -1
    entry = w[at + FIRST_SOURCE]
    while entry >= 0:
        source = w[w[SOURCES] + SOURCE_WIDTH * entry]
        trust = trust_of(w, source)
        if trust > most:
            best, most = source, trust
        entry = w[w[SOURCES] + SOURCE_WIDTH * entry + 1]
    is_alike = 1 if distance == w[last + 3] else 0
    is_like_older = 1 if distance == w[last] else 0
    set_context(w, 0, 0, best)
    set_context(w, 1, 0, w[at + N_SOURCES] << 16 | place << 8 | strength)
    set_context(w, 2, 0, short_of(best) << 16 | place << 8 | min(w[w[SMALL] + OUTCOME], 4))
    set_context(w, 3, 0, distance << 16 | w[last + 3] << 8 | w[last + 2])
    set_context(w, 4, 0, strength << 16 | is_alike << 8 | is_like_older)


@kernel
def _find(w: Any, words: Any, bits: Any, node: int, n_tried: int) -> int:
    """Code a node that was not proposed."""
    small = w[SMALL]
    last = small + LAST_DISTANCES
    wanted = FAR if w[READS] else w[w[DISTANCE] + node]
    distance = 1
    while distance < FAR:
        set_context(w, 0, 0, distance << 8 | w[last + 3])
        set_context(w, 1, 0, distance << 16 | w[last + 3] << 8 | w[last + 2])
        set_context(w, 2, 0, distance << 8 | w[last])
        if ask(w, words, _DISTANCE, 0, 3, 1 if wanted == distance else 0):
            break
        distance += 1
    rank = -1 if w[READS] else _rank_of(w, node, distance, n_tried)
    set_context(w, 0, 0, 0)
    if ask(w, words, _FAR, 0, 1, 1 if rank < 0 else 0):
        return _anywhere(w, bits, distance, node)
    set_context(w, 0, 0, distance)
    rank = code_number(w, words, bits, _RANK, 1, max(rank, 0))
    if not w[READS]:
        return node
    # Those that were asked for are passed over.
    _flip_tried(w, n_tried)
    n = 0
    if w[small + NODE] >= 0:
        n = search(w, w[small + NODE], w[small + ORIGIN], SEARCHED, NOWHERE, distance, rank)
    _flip_tried(w, n_tried)
    return int(w[w[AROUND] + n - 1]) if n else NOWHERE


@kernel
def _rank_of(w: Any, node: int, distance: int, n_tried: int) -> int:
    """Count what comes before a node among those of its distance near by; -1 if it is not there."""
    small = w[SMALL]
    if w[small + NODE] < 0:
        return -1
    n = search(w, w[small + NODE], w[small + ORIGIN], SEARCHED, node, distance, -1)
    if n < 2 or w[w[AROUND] + n - 1] != node:
        return -1
    _flip_tried(w, n_tried)
    rank = 0
    for place in range(1, n - 1):
        if w[w[DISTANCE] + w[w[AROUND] + place]] == distance:
            rank += 1
    _flip_tried(w, n_tried)
    return rank


@kernel
def _flip_tried(w: Any, n_tried: int) -> None:
    """Make the distances of proposals that were asked for none, or what they were."""
    for place in range(n_tried):
        proposal = w[w[SMALL] + _CHOSEN + place]
        v = w[w[PROPOSED] + PROPOSED_WIDTH * proposal + PROPOSED_NODE]
        w[w[DISTANCE] + v] = -1 - w[w[DISTANCE] + v]


@kernel
def _anywhere(w: Any, bits: Any, distance: int, node: int) -> int:
    n, free_at = w[VERTICES], w[FREE_AT]
    count = n if n > LARGEST_RANKED else 0
    place = node
    if n <= LARGEST_RANKED:
        place = 0
        for v in range(n):
            if w[free_at + v] == distance:
                count += 1
                place += v < node
    width = 0
    while count >> width:
        width += 1
    place = code_bits(w, bits, width, place)
    if w[STATUS]:
        return NOWHERE
    if n > LARGEST_RANKED:
        return place if place < n and w[free_at + place] >= 0 else NOWHERE
    for v in range(n):
        if w[free_at + v] == distance:
            if place == 0:
                return v
            place -= 1
    return NOWHERE
