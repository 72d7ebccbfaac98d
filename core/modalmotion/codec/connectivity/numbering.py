"""The number of each node of a surface: the order of the vertices.

Numbers are coded one after the other. The place of the next one depends on the places of those
before it: rows go on in steps that repeat, and refined meshes number the nodes between others in
the order of these others. So places are proposed, the likeliest first, and one answer each says
whether the number goes there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterator
from itertools import islice
from typing import Final

import numpy as np

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.bits.mixing import Mixer
from modalmotion.codec.connectivity.rings import NOWHERE, Path, Rings

MOST_RELATIONS: Final = 6
N_PROPOSED: Final = 16
# Nodes to look at around one: for the next, for the way to it, for numbers near it.
SEARCHED: Final = 400
REMEMBERED: Final = 120
NEAR: Final = 40
# The latest numbers are not used as neighbours to relate to.
JUST_BEFORE: Final = 4
RELATED_BACK: Final = 4
MOST_WAYS: Final = 12
RELATED_STEPS: Final = (1, -1, 2, -2)
FAR: Final = 6
LARGEST_RANKED: Final = 65536
# Numbers of the sources of proposals, after the five kinds of steps that repeat.
NEIGHBOURS: Final = 5
RELATIONS: Final = 6

# 1024 ln n, rounded.
LOGARITHMS: Final = (0, *(int(x) for x in np.rint(1024.0 * np.log(np.arange(1, 43)))))
MOST_TRUSTED: Final = 40
LIKE_THE_LAST: Final = 2048

_LONE, _HERE, _DISTANCE, _FAR, _RANK = range(100, 105)

Source = tuple[int, ...]
Proposals = dict[int, list[Source]]
Ends = list[list[int]]


class Numbering:
    """Number the nodes of a surface.

    Parameters
    ----------
    mixer : Mixer
    rings : Rings
    n_relations : int
        How many numbered nodes near each one to remember: 0 saves time.
    """

    def __init__(self, mixer: Mixer, rings: Rings, n_relations: int) -> None:
        n = len(rings.around)
        self.nodes: list[int] = []
        self._mixer = mixer
        self._rings = rings
        self._n_relations = n_relations
        self._lone = deque(v for v in range(n) if not rings.around[v])
        self._number = [-1] * n
        self._distance = [FAR] * n
        self._free_at = np.where([len(a) > 0 for a in rings.around], FAR, -1).astype(np.int8)
        # The latest numbered node with neighbours, and the node before it on the way.
        self._node = self._origin = NOWHERE
        self._paths: deque[Path | None] = deque([None] * 4, maxlen=4)
        self._distances: deque[int] = deque([FAR] * 4, maxlen=4)
        self._outcome = N_PROPOSED
        self._repeated: dict[Hashable, list[tuple[Path, int]]] = {}
        self._trust: dict[Source, list[int]] = {}
        # Of the latest numbers, the last first: for each relation, the ends of each step.
        self._relations: deque[list[Ends]] = deque(maxlen=RELATED_BACK)

    def code(self, node: int | None) -> int:
        """Code which node has the next number.

        Parameters
        ----------
        node : int, optional
            For a writer; of lone nodes the lowest free one is taken.

        Returns
        -------
        int
            The node that has it.
        """
        if self._lone:
            alone = None if node is None else not self._rings.around[node]
            if self._mixer.bit(_LONE, [0], alone):
                node = self._lone.popleft()
                self._number_next(node, [])
                return node
        proposals = self._proposals()
        trust = {who: self._trusted(who) for sources in proposals.values() for who in sources}
        total = {v: sum(trust[who] for who in sources) for v, sources in proposals.items()}
        alike = self._distances[-1]
        ranking = {v: -t - LIKE_THE_LAST * (self._distance[v] == alike) for v, t in total.items()}
        likeliest = sorted(proposals, key=ranking.__getitem__)[:N_PROPOSED]
        next_node = NOWHERE
        for place, candidate in enumerate(likeliest):
            best = max(proposals[candidate], key=trust.__getitem__)
            contexts = self._contexts(place, candidate, total, best, len(proposals[candidate]))
            here = None if node is None else candidate == node
            if self._mixer.bit(_HERE + 10 * (1 + min(place, 3)), contexts, here):
                next_node = candidate
                break
        self._outcome = place if next_node != NOWHERE else N_PROPOSED
        if next_node == NOWHERE:
            next_node = self._search(set(likeliest), node)
        for candidate, sources in proposals.items():
            for who in sources:
                self._judge(who, candidate == next_node)
        self._go_to(next_node)
        return next_node

    def _contexts(
        self, place: int, node: int, total: dict[int, int], best: Source, n_sources: int
    ) -> list[Hashable]:
        strength = min(15, 3 * total[node] // 1024)
        distance, last = self._distance[node], self._distances
        return [
            best,
            (place, n_sources, strength),
            (best[:2], place, min(self._outcome, 4)),
            (distance, last[-1], last[-2]),
            (strength, distance == last[-1], distance == last[-4]),
        ]

    def _proposals(self) -> Proposals:
        """Free nodes, and the sources that propose each."""
        proposals: Proposals = {}
        if self._node == NOWHERE:
            return proposals

        def propose(node: int, who: Source) -> None:
            if node != NOWHERE and self._number[node] < 0:
                proposals.setdefault(node, []).append(who)

        rings = self._rings
        for model, context in enumerate(self._recent()):
            for place, (path, repeats) in enumerate(self._repeated.get((model, context), ())):
                propose(rings.follow(self._node, self._origin, path), (model, place, repeats))
        n_around = len(rings.around[self._node])
        for turn, node in enumerate(rings.seen_from(self._node, self._origin)):
            propose(node, (NEIGHBOURS, min(turn, 5), n_around))
        for back, relations in enumerate(self._relations):
            for place, ends in enumerate(relations):
                for sign, nodes in enumerate(ends):
                    for node in nodes:
                        propose(node, (RELATIONS + 4 * back + sign, place))
        return proposals

    def _recent(self) -> list[Hashable]:
        """List contexts that the next step may depend on."""
        paths, number = self._paths, self._number
        around = self._rings.seen_from(self._node, self._origin)
        taken = tuple(number[v] >= 0 for v in around)
        last = paths[-1]
        return [last, (paths[-2], last), tuple(paths), taken, (taken, last)]

    def _search(self, tried: set[int], node: int | None) -> int:
        """Code a node that was not proposed."""
        last = self._distances
        distance = FAR if node is None else self._distance[node]
        for d in range(1, FAR):
            contexts = [(d, last[-1]), (d, last[-1], last[-2]), (d, last[-4])]
            if self._mixer.bit(_DISTANCE, contexts, None if node is None else distance == d):
                distance = d
                break
        else:
            distance = FAR
        around = self._around(tried, distance)
        rank = None
        if node is not None:
            rank = next((i for i, v in enumerate(around) if v == node), None)
            around = self._around(tried, distance)
        if not self._mixer.bit(_FAR, [0], None if node is None else rank is None):
            rank = self._mixer.number(_RANK, [distance], rank)
            next_node = next(islice(around, rank, None), NOWHERE)
        else:
            next_node = self._anywhere(distance, node)
        if next_node == NOWHERE:
            raise damaged("The stream numbers a vertex that does not exist.")
        return next_node

    def _around(self, tried: set[int], distance: int) -> Iterator[int]:
        """Free nodes near the last one, at a distance from numbered nodes."""
        if self._node != NOWHERE:
            around = self._rings.breadth_first(self._node, self._origin, SEARCHED)
            for v in around.nodes[1:]:
                if self._number[v] < 0 and self._distance[v] == distance and v not in tried:
                    yield v

    def _anywhere(self, distance: int, node: int | None) -> int:
        n = len(self._number)
        if n > LARGEST_RANKED:
            next_node = self._mixer.plain(n.bit_length(), node)
            free = next_node < n and self._free_at[next_node] >= 0
            return next_node if free else NOWHERE
        free_nodes = np.flatnonzero(self._free_at == distance)
        place = None if node is None else int(np.searchsorted(free_nodes, node))
        place = self._mixer.plain(len(free_nodes).bit_length(), place)
        return int(free_nodes[place]) if place < len(free_nodes) else NOWHERE

    def _trusted(self, who: Source) -> int:
        """1024 times the logarithm of 1 / its share of wrong proposals."""
        right, wrong = self._trust.get(who, (1, 1))
        return LOGARITHMS[right + wrong] - LOGARITHMS[wrong]

    def _judge(self, who: Source, right: bool) -> None:
        counts = self._trust.setdefault(who, [1, 1])
        counts[not right] += 1
        if counts[0] + counts[1] > MOST_TRUSTED:
            counts[0] = (counts[0] + 1) // 2
            counts[1] = (counts[1] + 1) // 2

    def _go_to(self, node: int) -> None:
        """Give the next number to a node, and learn from its place."""
        path, origin = None, NOWHERE
        if self._node != NOWHERE:
            around = self._rings.breadth_first(self._node, self._origin, REMEMBERED, node)
            if around.nodes[-1] == node:
                way = around.way_back(len(around.nodes) - 1)[::-1]
                path, origin = self._rings.path_along(self._origin, way), way[-2]
            for model, context in enumerate(self._recent()):
                _remember(self._repeated.setdefault((model, context), []), path)
        if origin == NOWHERE:
            origin = self._rings.around[node][0]
        self._paths.append(path)
        self._distances.append(self._distance[node])
        self._node, self._origin = node, origin
        relations = self._related(node, origin) if self._n_relations else []
        self._number_next(node, relations)
        self._spread(node)

    def _number_next(self, node: int, relations: list[Ends]) -> None:
        self._number[node] = len(self.nodes)
        self._free_at[node] = -1
        self.nodes.append(node)
        self._relations.appendleft(relations)

    def _related(self, node: int, origin: int) -> list[Ends]:
        """List the ends of ways to nodes near a node, walked from nodes of neighbouring numbers."""
        rings, relations, n = self._rings, [], len(self.nodes)
        around = rings.breadth_first(node, origin, NEAR)
        for place, v in enumerate(around.nodes):
            number = self._number[v]
            if not 0 <= number < n - JUST_BEFORE:
                continue
            path = rings.path_along(NOWHERE, around.way_back(place))
            ends: Ends = []
            for step in RELATED_STEPS:
                base = self.nodes[number + step] if number + step >= 0 else NOWHERE
                ways = rings.around[base][:MOST_WAYS] if base != NOWHERE else []
                ends.append([rings.follow(base, way, path) for way in ways])
            relations.append(ends)
            if len(relations) == self._n_relations:
                break
        return relations

    def _spread(self, node: int) -> None:
        """Update the distances of free nodes from numbered ones."""
        distance = self._distance
        distance[node] = 0
        row = deque([node])
        while row:
            v = row.popleft()
            further = distance[v] + 1
            if further == FAR:
                continue
            for w in self._rings.around[v]:
                if distance[w] > further:
                    distance[w] = further
                    self._free_at[w] = further
                    row.append(w)


def _remember(steps: list[tuple[Path, int]], path: Path | None) -> None:
    """Put a path first, and count its repeats."""
    if path is None:
        return
    repeats = next((count + 1 for known, count in steps if known == path), 0)
    steps[:] = [(path, min(repeats, 5)), *((p, c) for p, c in steps if p != path)][:2]
