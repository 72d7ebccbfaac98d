"""Triangles as a walk over their corners, compiled: the twin of `connectivity.walk`."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.codec.connectivity.walk import AHEAD, BEHIND, GIVEN_UP, NEW, OLDER
from modalmotion.codec.kernels.answers import ask, code_number, place_of, set_context
from modalmotion.codec.kernels.coding import fail
from modalmotion.codec.machine.layout import NO_VERTEX, READS
from modalmotion.codec.machine.places import (
    AT_ROLE,
    CODES,
    CORNER,
    EDGES,
    FACE,
    FIRST_PIVOT,
    KINDS,
    LAST_AHEAD,
    LAST_BEHIND,
    LATEST,
    N_AROUND,
    N_DONE,
    N_EDGES,
    N_MET,
    N_PIVOTS,
    NEWER,
    PERIOD,
    PIVOTS,
    TAG_EDGE,
    VERTICES,
)
from modalmotion.codec.machine.places import OLDER as OLDER_THAN
from modalmotion.numeric.machine.compiled import kernel

_OLDER_QUESTION: Final = 12
_SIX_CODES: Final = (1 << 42) - 1
_GIVEN_UP_CODE: Final = 64
# Of an open edge: its start, its end, how often it is open, and its neighbours in two lists.
_START, _END, _COUNT, _EARLIER_AHEAD, _LATER_AHEAD, _EARLIER_BEHIND, _LATER_BEHIND = range(7)
N_EDGE: Final = 7
_NOBODY: Final = -1


@kernel
def first_pivot(w: Any) -> int:
    """Give the pivot, or -1."""
    if w[FIRST_PIVOT] == w[N_PIVOTS]:
        return _NOBODY
    return int(w[w[PIVOTS] + w[FIRST_PIVOT]])


@kernel
def _ahead_of(w: Any, node: int) -> int:
    edge = w[w[LAST_AHEAD] + node]
    return w[w[EDGES] + N_EDGE * edge + _END] if edge else _NOBODY


@kernel
def _behind(w: Any, node: int) -> int:
    edge = w[w[LAST_BEHIND] + node]
    return w[w[EDGES] + N_EDGE * edge + _START] if edge else _NOBODY


@kernel
def earlier_ahead(w: Any, edge: int) -> int:
    """Give the open edge that leaves the same node and was opened before."""
    return int(w[w[EDGES] + N_EDGE * edge + _EARLIER_AHEAD])


@kernel
def end_of(w: Any, edge: int) -> int:
    """Give the end of an open edge."""
    return int(w[w[EDGES] + N_EDGE * edge + _END])


@kernel
def _unlink(w: Any, edge: int, node: int, last: int, earlier: int, later: int) -> None:
    at = w[EDGES] + N_EDGE * edge
    before, after = w[at + earlier], w[at + later]
    if before:
        w[w[EDGES] + N_EDGE * before + later] = after
    if after:
        w[w[EDGES] + N_EDGE * after + earlier] = before
    else:
        w[w[last] + node] = before


@kernel
def _link_last(w: Any, edge: int, node: int, last: int, earlier: int, later: int) -> None:
    at = w[EDGES] + N_EDGE * edge
    before = w[w[last] + node]
    w[at + earlier] = before
    w[at + later] = 0
    if before:
        w[w[EDGES] + N_EDGE * before + later] = edge
    w[w[last] + node] = edge


@kernel
def _pass_edge(w: Any, start: int, end: int) -> None:
    """Close the open edge that this one lies on, or open one for a face beyond it."""
    edge = w[place_of(w, TAG_EDGE | start << 5, end)]
    if edge and w[w[EDGES] + N_EDGE * edge + _COUNT]:
        at = w[EDGES] + N_EDGE * edge
        w[at + _COUNT] -= 1
        if not w[at + _COUNT]:
            _unlink(w, edge, start, LAST_AHEAD, _EARLIER_AHEAD, _LATER_AHEAD)
            _unlink(w, edge, end, LAST_BEHIND, _EARLIER_BEHIND, _LATER_BEHIND)
        return
    place = place_of(w, TAG_EDGE | end << 5, start)
    edge = w[place]
    if not edge:
        w[N_EDGES] += 1
        edge = w[N_EDGES]
        w[place] = edge
        at = w[EDGES] + N_EDGE * edge
        w[at + _START] = end
        w[at + _END] = start
        w[at + _COUNT] = 0
    at = w[EDGES] + N_EDGE * edge
    if w[at + _COUNT]:
        _unlink(w, edge, end, LAST_AHEAD, _EARLIER_AHEAD, _LATER_AHEAD)
        _unlink(w, edge, start, LAST_BEHIND, _EARLIER_BEHIND, _LATER_BEHIND)
    w[at + _COUNT] += 1
    _link_last(w, edge, end, LAST_AHEAD, _EARLIER_AHEAD, _LATER_AHEAD)
    _link_last(w, edge, start, LAST_BEHIND, _EARLIER_BEHIND, _LATER_BEHIND)


@kernel
def _drop_closed(w: Any) -> None:
    """Drop pivots whose fan has closed, even if an edge of it opens again."""
    while w[FIRST_PIVOT] < w[N_PIVOTS] and not w[w[LAST_AHEAD] + first_pivot(w)]:
        w[FIRST_PIVOT] += 1


@kernel
def _role(w: Any) -> int:
    return int(3 * (w[N_DONE] % w[PERIOD]) + w[CORNER])


@kernel
def _set_contexts(w: Any, behind: int) -> None:
    corner, kinds, codes, role = w[CORNER], w[KINDS], w[CODES], _role(w)
    around = w[N_AROUND]
    first = second = third = 0
    if corner:
        first = w[around + w[FACE]] + 1
    elif first_pivot(w) >= 0:
        first = w[around + first_pivot(w)] + 1
    if corner == 2:
        second = w[around + w[FACE + 1]] + 1
    if behind >= 0:
        third = w[around + behind] + 1
    at_role = w[w[AT_ROLE] + role]
    set_context(w, 0, kinds, role << 21 | (codes & 0x1FFFFF))
    set_context(w, 1, kinds, role << 42 | codes)
    set_context(w, 2, third << 4 | kinds, second << 32 | first)
    set_context(w, 3, (codes & 0x3FFF) << 4 | kinds, third << 32 | first)
    set_context(w, 4, (codes & 0x7F) << 4 | kinds, first)
    set_context(w, 5, kinds, second << 32 | first)
    set_context(w, 6, at_role << 4 | kinds, role)


@kernel
def _named(w: Any, words: Any, bits: Any, node: int) -> int:
    """Code a node by how many others were corners since it was one."""
    ago = 0
    if not w[READS]:
        v = w[LATEST]
        while v != node:
            v = w[w[OLDER_THAN] + v]
            ago += 1
    set_context(w, 0, 0, w[CORNER])
    set_context(w, 1, 0, _role(w))
    ago = code_number(w, words, bits, _OLDER_QUESTION, 2, ago)
    v = w[LATEST]
    while ago and v >= 0:
        v = w[w[OLDER_THAN] + v]
        ago -= 1
    return int(v)


@kernel
def _make_latest(w: Any, node: int, is_new: bool) -> None:
    older, newer = w[OLDER_THAN], w[NEWER]
    if not is_new:
        if w[LATEST] == node:
            return
        before, after = w[older + node], w[newer + node]
        w[older + after] = before
        if before >= 0:
            w[newer + before] = after
    w[older + node] = w[LATEST]
    w[newer + node] = _NOBODY
    if w[LATEST] >= 0:
        w[newer + w[LATEST]] = node
    w[LATEST] = node


@kernel
def code_corner(w: Any, words: Any, bits: Any, node: int) -> int:
    """Code a corner: its node, or `GIVEN_UP`."""
    corner = w[CORNER]
    behind = _NOBODY
    if corner:
        ahead = _ahead_of(w, w[FACE + corner - 1])
        behind = _behind(w, w[FACE])
    else:
        ahead = first_pivot(w)
    wanted = OLDER
    if node == GIVEN_UP:
        wanted = BEHIND
    elif node == ahead:
        wanted = AHEAD
    elif node == behind:
        wanted = BEHIND
    elif node >= w[N_MET]:
        wanted = NEW
    _set_contexts(w, behind)
    kind = OLDER
    for turn in range(3):
        # Ahead, behind, new; ahead, new, behind; new, behind, ahead.
        if corner == 0:
            candidate = AHEAD if turn == 0 else (BEHIND if turn == 1 else NEW)
        elif corner == 1:
            candidate = AHEAD if turn == 0 else (NEW if turn == 1 else BEHIND)
        else:
            candidate = NEW if turn == 0 else (BEHIND if turn == 1 else AHEAD)
        if candidate == AHEAD and ahead < 0:
            continue
        if candidate == BEHIND and (behind < 0 if corner else ahead < 0):
            continue
        if ask(w, words, 4 * corner + candidate, 0, 7, 1 if wanted == candidate else 0):
            kind = candidate
            break
    if corner == 0 and kind == BEHIND:
        w[FIRST_PIVOT] += 1
        _drop_closed(w)
        w[CODES] = (w[CODES] << 7 | _GIVEN_UP_CODE) & _SIX_CODES
        return GIVEN_UP
    if kind == AHEAD:
        node = ahead
    elif kind == BEHIND:
        node = behind
    elif kind == NEW:
        node = w[N_MET]
    else:
        node = _named(w, words, bits, node)
    if node < 0 or node >= w[VERTICES]:
        fail(w, NO_VERTEX)
        return 0
    _take(w, node, kind)
    return node


@kernel
def _take(w: Any, node: int, kind: int) -> None:
    if kind == NEW:
        w[N_MET] += 1
        w[w[PIVOTS] + w[N_PIVOTS]] = node
        w[N_PIVOTS] += 1
    _make_latest(w, node, kind == NEW)
    w[w[AT_ROLE] + _role(w)] = kind
    w[KINDS] = 4 * w[KINDS] + kind
    w[FACE + w[CORNER]] = node
    w[CORNER] += 1
    if w[CORNER] == 3:
        for i in range(3):
            start, end = w[FACE + i], w[FACE + (i + 1) % 3]
            _pass_edge(w, start, end)
            w[w[N_AROUND] + start] += 1
        w[CODES] = (w[CODES] << 7 | w[KINDS]) & _SIX_CODES
        w[CORNER] = 0
        w[KINDS] = 0
        w[N_DONE] += 1
        _drop_closed(w)
