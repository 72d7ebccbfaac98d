"""Ordered neighbours (one-rings) of each vertex."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

NOWHERE: Final = -1
MOST_LOOKS: Final = 8
"""Neighbours to look at for each node of a search: hubs have very many."""

Path = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Nodes around a node, itself the first.

    Parameters
    ----------
    nodes : list of int
    parents : list of int
        Place of the node from which each was reached.
    """

    nodes: list[int]
    parents: list[int]

    def way_back(self, place: int) -> list[int]:
        """Nodes from a place to the first one, inclusive."""
        way = []
        while place != NOWHERE:
            way.append(self.nodes[place])
            place = self.parents[place]
        return way


class Rings:
    """Neighbours of each node, in order around it.

    Parameters
    ----------
    n_nodes : int
    triangles : list of (int, int, int)
    """

    def __init__(self, n_nodes: int, triangles: list[list[int]]) -> None:
        after: list[dict[int, int]] = [{} for _ in range(n_nodes)]
        before: list[dict[int, int]] = [{} for _ in range(n_nodes)]
        beside: list[dict[int, None]] = [{} for _ in range(n_nodes)]
        for a, b, c in triangles:
            for v, x, y in ((a, b, c), (b, c, a), (c, a, b)):
                beside[v][x] = None
                beside[v][y] = None
                if x not in after[v] and y not in before[v]:
                    after[v][x] = y
                    before[v][y] = x
        self._place: list[dict[int, int]] = []
        for v in range(n_nodes):
            place: dict[int, int] = {}
            # Chains begin at a border; what is left are closed rings.
            for first in (*(x for x in beside[v] if x not in before[v]), *beside[v]):
                x = first
                while x != NOWHERE and x not in place:
                    place[x] = len(place)
                    x = after[v].get(x, NOWHERE)
            self._place.append(place)
        self.around = [list(place) for place in self._place]

    def seen_from(self, node: int, origin: int) -> list[int]:
        """List the neighbours, beginning after the origin."""
        around = self.around[node]
        first = self._place[node].get(origin, NOWHERE) + 1
        return around[first:] + around[:first]

    def follow(self, node: int, origin: int, path: Path) -> int:
        """Walk along turns; `NOWHERE` where a node has too few neighbours."""
        for turn in path:
            around = self.around[node]
            n = len(around)
            if turn >= n:
                return NOWHERE
            place = self._place[node].get(origin, NOWHERE) + 1 + turn
            origin, node = node, around[place if place < n else place - n]
        return node

    def path_along(self, origin: int, nodes: list[int]) -> Path:
        """List the turns from the first node along the others, for a walk from an origin."""
        turns = []
        for here, there in pairwise(nodes):
            place = self._place[here]
            turn = place[there] - place.get(origin, NOWHERE) - 1
            turns.append(turn if turn >= 0 else turn + len(place))
            origin = here
        return tuple(turns)

    def breadth_first(self, node: int, origin: int, most: int, goal: int = NOWHERE) -> Surroundings:
        """List the nodes around a node, near ones first: at most so many, or up to a goal."""
        nodes, parents = [node], [NOWHERE]
        seen = {node}
        looks = MOST_LOOKS * most
        for parent, here in enumerate(nodes):
            before = origin if parent == 0 else nodes[parents[parent]]
            # A hub has more neighbours than there is time for.
            looks -= len(self.around[here])
            if looks <= 0:
                break
            for there in self.seen_from(here, before):
                if there not in seen:
                    seen.add(there)
                    nodes.append(there)
                    parents.append(parent)
                    if there == goal or len(nodes) > most:
                        return Surroundings(nodes, parents)
        return Surroundings(nodes, parents)
