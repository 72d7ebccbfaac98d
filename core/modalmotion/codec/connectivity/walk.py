"""Connectivity as a walk over the corners of triangles."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from itertools import islice
from typing import Final

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.bits.mixing import Mixer

NEW: Final = 0
AHEAD: Final = 1
BEHIND: Final = 2
OLDER: Final = 3
"""Kinds of corners: never seen, next along the border, before it, or seen some time ago.

Of the first corner, `AHEAD` says that it is the pivot, the node seen first whose fan of
triangles is still open, and `BEHIND` that the pivot's fan ends at the border of the surface: it
is no longer a pivot, and the first corner is coded again.
"""

GIVEN_UP: Final = -1

# Kinds to ask for at each corner, in this order.
_KINDS: Final = ((AHEAD, BEHIND, NEW), (AHEAD, NEW, BEHIND), (NEW, BEHIND, AHEAD))
_OLDER: Final = 12


class Walk:
    """State that encoder and decoder share while they pass the triangles.

    Nodes are numbered in the order in which they are met.

    Parameters
    ----------
    mixer : Mixer
    n_nodes : int
    period : int
        Triangles after which the pattern may repeat.
    """

    def __init__(self, mixer: Mixer, n_nodes: int, period: int) -> None:
        self.n_met = 0
        self._mixer = mixer
        self._n_nodes = n_nodes
        self._period = period
        self._recent: dict[int, None] = {}
        self._pivots: deque[int] = deque()
        # Ends of the open edges that leave a node, and starts of those that reach it; the one
        # opened last is last. An edge can be open several times.
        self._ahead: dict[int, dict[int, int]] = {}
        self._behind: dict[int, dict[int, int]] = {}
        self._n_around = [0] * n_nodes
        self._face: list[int] = []
        self._kinds = 0
        self._codes: deque[int] = deque([0] * 6, maxlen=6)
        self._at_role = [0] * (3 * period)
        self._n_faces = 0

    @property
    def pivot(self) -> int | None:
        """The earliest node whose fan is open."""
        return self._pivots[0] if self._pivots else None

    def open_ends(self, node: int) -> list[int]:
        """List the ends of the open edges that leave a node, the last one opened first."""
        return list(reversed(self._ahead.get(node, {})))

    def kind_of(self, node: int) -> int:
        """Kind of the next corner."""
        ahead, behind = self._candidates()
        if node == ahead:
            return AHEAD
        if node == behind:
            return BEHIND
        return NEW if node >= self.n_met else OLDER

    def code(self, node: int | None, kind: int | None) -> int:
        """Code a corner.

        Parameters
        ----------
        node, kind : int, optional
            For a writer.

        Returns
        -------
        int
            The node, or `GIVEN_UP`.
        """
        corner = len(self._face)
        ahead, behind = self._candidates()
        contexts = self._contexts(behind)
        coded_kind = OLDER
        for candidate in _KINDS[corner]:
            possible = candidate == NEW or (ahead if candidate == AHEAD else behind) is not None
            possible = possible or (candidate == BEHIND and corner == 0 and ahead is not None)
            if not possible:
                continue
            question = 4 * corner + candidate
            if self._mixer.bit(question, contexts, None if kind is None else kind == candidate):
                coded_kind = candidate
                break
        if corner == 0 and coded_kind == BEHIND:
            self._pivots.popleft()
            self._drop_closed()
            self._codes.append(64)
            return GIVEN_UP
        node = self._named(coded_kind, ahead, behind, node)
        self._take(node, coded_kind)
        return node

    def _named(self, kind: int, ahead: int | None, behind: int | None, node: int | None) -> int:
        if kind == AHEAD and ahead is not None:
            return ahead
        if kind == BEHIND and behind is not None:
            return behind
        if kind == NEW:
            result = self.n_met
        else:
            latest = reversed(self._recent)
            ago = None if node is None else next(i for i, v in enumerate(latest) if v == node)
            ago = self._mixer.number(_OLDER, [len(self._face), self._role()], ago)
            result = next(islice(reversed(self._recent), ago, None), self._n_nodes)
        if result >= self._n_nodes:
            raise damaged("A face of the stream names a vertex that does not exist.")
        return result

    def _contexts(self, behind: int | None) -> list[Hashable]:
        face, codes = self._face, tuple(self._codes)
        pivot = self.pivot
        around = [self._n_around[v] for v in face]
        if not face and pivot is not None:
            around = [self._n_around[pivot]]
        first, second = (*around, -1, -1)[:2]
        third = -1 if behind is None else self._n_around[behind]
        kinds, role = self._kinds, self._role()
        return [
            (role, kinds, codes[-3:]),
            (role, kinds, codes),
            (kinds, first, second, third),
            (kinds, first, third, codes[-2:]),
            (kinds, first, codes[-1]),
            (kinds, first, second),
            (role, kinds, self._at_role[role]),
        ]

    def _role(self) -> int:
        return 3 * (self._n_faces % self._period) + len(self._face)

    def _take(self, node: int, kind: int) -> None:
        if kind == NEW:
            self.n_met += 1
            self._pivots.append(node)
        else:
            del self._recent[node]
        self._recent[node] = None
        self._at_role[self._role()] = kind
        self._kinds = 4 * self._kinds + kind
        self._face.append(node)
        if len(self._face) == 3:
            a, b, c = self._face
            for start, end in ((a, b), (b, c), (c, a)):
                self._pass(start, end)
                self._n_around[start] += 1
            self._codes.append(self._kinds)
            self._face, self._kinds = [], 0
            self._n_faces += 1
            self._drop_closed()

    def _drop_closed(self) -> None:
        """Drop pivots whose fan has closed, even if an edge of it opens again."""
        while self._pivots and not self._ahead.get(self._pivots[0]):
            self._pivots.popleft()

    def _candidates(self) -> tuple[int | None, int | None]:
        """Find the ends of edges that leave the corner before, and that reach the first corner."""
        if not self._face:
            return self.pivot, None
        ahead = self._ahead.get(self._face[-1])
        behind = self._behind.get(self._face[0])
        return (
            next(reversed(ahead)) if ahead else None,
            next(reversed(behind)) if behind else None,
        )

    def _pass(self, start: int, end: int) -> None:
        """Close the open edge that this one lies on, or open one for a face beyond it."""
        if end in self._ahead.get(start, ()):
            _take_from(self._ahead[start], end)
            _take_from(self._behind[end], start)
        else:
            _put_last(self._ahead.setdefault(end, {}), start)
            _put_last(self._behind.setdefault(start, {}), end)


def _put_last(counts: dict[int, int], node: int) -> None:
    counts[node] = counts.pop(node, 0) + 1


def _take_from(counts: dict[int, int], node: int) -> None:
    counts[node] -= 1
    if not counts[node]:
        del counts[node]
