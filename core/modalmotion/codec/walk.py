"""Connectivity as a walk over the corners of triangles, in their own order."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from typing import Final

NEW: Final = 0
AHEAD: Final = 1
BEHIND: Final = 2
OLDER: Final = 3
"""What a corner is: never seen, next along the border, before it, or seen some time ago.

Of the first corner, `AHEAD` says that it is the pivot, the vertex seen first whose fan of
triangles is still open, and `BEHIND` that the pivot's fan ends at the border of the surface: it
is a pivot no more, and the first corner is told again.
"""

SAME_ROLE: Final = 0
NEARBY: Final = 1
"""What the number of a vertex never seen is compared with."""

N_NEARBY: Final = 48


@dataclass(frozen=True)
class WalkRules:
    """How symbols are told apart, and numbers predicted.

    Parameters
    ----------
    period : int
        Faces after which the pattern of a subdivided mesh repeats.
    prediction : {0, 1}
        The number of a new vertex is compared with that of the last new one at the same corner
        of the same face of the period, or looked for beside those of vertices seen lately.
    """

    period: int
    prediction: int


class Walk:
    """What both sides know while the faces go by.

    Parameters
    ----------
    n_vertices : int
    rules : WalkRules
    """

    def __init__(self, n_vertices: int, rules: WalkRules) -> None:
        self.rules = rules
        self._free = list(range(n_vertices))
        self._recent: list[int] = []
        self._pivots: deque[int] = deque()
        self._ahead: dict[int, list[int]] = {}
        self._behind: dict[int, list[int]] = {}
        self._last_new = 0
        self._last_of_role: dict[int, int] = {}
        self._face: list[int] = []
        self._n_faces = 0
        self._kind = OLDER
        self._second_kind = OLDER

    @property
    def role(self) -> int:
        """Place of the next corner in the period."""
        return 3 * (self._n_faces % self.rules.period) + len(self._face)

    @property
    def pivot(self) -> int | None:
        """The vertex seen first whose fan is open."""
        return self._pivots[0] if self._pivots else None

    def open_ends(self, vertex: int) -> list[int]:
        """List the ends of the open edges that leave a vertex, the last one opened first."""
        return self._ahead.get(vertex, [])[::-1]

    @property
    def context(self) -> int:
        """Which symbols the next one is counted with."""
        return (self.role * 4 + self._kind) * 4 + self._second_kind

    def symbol_of(self, vertex: int) -> int:
        """Symbol of the next corner: new, ahead, behind, or how long ago it was seen."""
        ahead, behind = self._candidates()
        if vertex == ahead:
            return AHEAD
        if vertex == behind:
            return BEHIND
        place = bisect_left(self._free, vertex)
        if place < len(self._free) and self._free[place] == vertex:
            return NEW
        recent = self._recent
        return OLDER + len(recent) - 1 - _rindex(recent, vertex)

    def vertex_of(self, symbol: int) -> int:
        """Vertex of a symbol that is not `NEW`; -1 if there is none."""
        if symbol in (AHEAD, BEHIND):
            found = self._candidates()[symbol - AHEAD]
            return -1 if found is None else found
        place = len(self._recent) - 1 - (symbol - OLDER)
        return self._recent[place] if place >= 0 else -1

    def change_of(self, vertex: int) -> int:
        """Compare the number of a new vertex among the unused ones, with that of its prediction."""
        return bisect_left(self._free, vertex) - bisect_left(self._free, self._predicted())

    def new_vertex(self, change: int) -> int:
        """Undo `change_of`; -1 if there is no such vertex."""
        place = bisect_left(self._free, self._predicted()) + change
        return self._free[place] if 0 <= place < len(self._free) else -1

    def nearby(self) -> list[int]:
        """List the unused numbers next above and below those seen lately, the latest first."""
        found: dict[int, None] = {}
        free = self._free
        for vertex in self._recent[: -N_NEARBY - 1 : -1]:
            place = bisect_left(free, vertex)
            if place < len(free):
                found[free[place]] = None
            if place:
                found[free[place - 1]] = None
        return list(found)

    def take(self, vertex: int, symbol: int) -> None:
        """Go on to the next corner."""
        if symbol == BEHIND and not self._face:
            self._pivots.popleft()
            self._drop_closed()
            self._second_kind, self._kind = self._kind, symbol
            return
        if symbol == NEW:
            self._pivots.append(vertex)
            self._free.pop(bisect_left(self._free, vertex))
            self._last_new = self._last_of_role[self.role] = vertex
        else:
            recent = self._recent
            del recent[_rindex(recent, vertex)]
        self._recent.append(vertex)
        self._second_kind, self._kind = self._kind, min(symbol, OLDER)
        self._face.append(vertex)
        if len(self._face) == 3:
            a, b, c = self._face
            for start, end in ((a, b), (b, c), (c, a)):
                self._pass(start, end)
            self._face = []
            self._n_faces += 1
            self._drop_closed()

    def _drop_closed(self) -> None:
        """Drop pivots whose fan has closed, even if an edge of it opens again."""
        while self._pivots and not self._ahead.get(self._pivots[0]):
            self._pivots.popleft()

    def _predicted(self) -> int:
        if self.rules.prediction == SAME_ROLE:
            return self._last_of_role.get(self.role, self._last_new)
        return self._recent[-1] if self._recent else 0

    def _candidates(self) -> tuple[int | None, int | None]:
        """Find the ends of edges that leave the corner before, and that reach the first corner."""
        if not self._face:
            return self.pivot, None
        ahead = self._ahead.get(self._face[-1])
        behind = self._behind.get(self._face[0])
        return (ahead[-1] if ahead else None), (behind[-1] if behind else None)

    def _pass(self, start: int, end: int) -> None:
        """Close the open edge that this one lies on, or open one for a face beyond it."""
        open_edges = self._ahead.get(start)
        if open_edges and end in open_edges:
            open_edges.remove(end)
            self._behind[end].remove(start)
        else:
            self._ahead.setdefault(end, []).append(start)
            self._behind.setdefault(start, []).append(end)


def _rindex(numbers: list[int], number: int) -> int:
    """Last place of a number that is there."""
    place = len(numbers) - 1
    while numbers[place] != number:
        place -= 1
    return place
