"""Faces of a stream, read from docs/format.md alone: section 10."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from itertools import pairwise
from typing import Any

import numpy as np
from text_of_numbers import Coded, Mixer


def walk(data: bytes, M: int, N: int) -> list[list[int]]:
    """Section 10, kind 0."""
    mixer = Mixer(Coded(data[2:]))
    triangles, n_met = walk_triangles(mixer, M)
    node_of = order_of_vertices(mixer, triangles, N, data[1])
    vertex_of = {node: vertex for vertex, node in enumerate(node_of)}
    assert sorted(vertex_of) == list(range(N))
    assert n_met <= N
    return [[vertex_of[node] for node in face] for face in triangles]


def walk_triangles(mixer: Mixer, M: int) -> tuple[list[list[int]], int]:
    pivots, n_met = deque[int](), 0
    ahead: dict[int, list[int]] = defaultdict(list)
    behind: dict[int, list[int]] = defaultdict(list)
    around: dict[int, int] = defaultdict(int)
    codes, at_corner = (0,) * 6, dict[int, int]()
    faces: list[list[int]] = []

    def drop() -> None:
        while pivots and not ahead[pivots[0]]:
            pivots.popleft()

    face: list[int] = []
    kinds = 0
    while len(faces) < M:
        corner = len(face)
        named: dict[int, int] = {0: n_met}
        if corner:
            if ahead[face[-1]]:
                named[1] = ahead[face[-1]][-1]
            if behind[face[0]]:
                named[2] = behind[face[0]][-1]
        elif pivots:
            named[1], named[2] = pivots[0], -1
        a = b = y = -1
        if corner or pivots:
            a = around[face[0] if corner else pivots[0]]
        if corner == 2:
            b = around[face[1]]
        if corner and 2 in named:
            y = around[named[2]]
        contexts = (
            (corner, kinds, codes[-3:]),
            (corner, kinds, codes),
            (kinds, a, b, y),
            (kinds, a, y, codes[-2:]),
            (kinds, a, codes[-1]),
            (kinds, a, b),
            (corner, kinds, at_corner.get(corner, 0)),
        )
        kind = 3
        for asked in ((1, 2, 0), (1, 0, 2), (0, 2, 1))[corner]:
            if asked in named and mixer.bit((corner, asked), *contexts):
                kind = asked
                break
        if kind == 2 and not corner:
            pivots.popleft()
            drop()
            codes = (*codes[1:], 64)
            continue
        v = n_met - 1 - mixer.number("older", corner) if kind == 3 else named[kind]
        if kind == 0:
            n_met += 1
            pivots.append(v)
        face.append(v)
        at_corner[corner] = kind
        kinds = 4 * kinds + kind
        if corner == 2:
            for s, e in zip(face, face[1:] + face[:1], strict=True):
                if e in ahead[s]:
                    ahead[s].remove(e)
                    behind[e].remove(s)
                else:
                    ahead[e].append(s)
                    behind[s].append(e)
                around[s] += 1
            codes = (*codes[1:], kinds)
            faces.append(face)
            face, kinds = [], 0
            drop()
    return faces, n_met


Route = tuple[int, ...]


def rings_of(triangles: list[list[int]], N: int) -> list[list[int]]:
    neighbours: list[list[int]] = [[] for _ in range(N)]
    after: list[dict[int, int]] = [{} for _ in range(N)]
    for a, b, c in triangles:
        for v, x, y in ((a, b, c), (b, c, a), (c, a, b)):
            neighbours[v] += [w for w in dict.fromkeys((x, y)) if w not in neighbours[v]]
            if x not in after[v] and y not in after[v].values():
                after[v][x] = y
    rings = []
    for v in range(N):
        ring: list[int] = []
        starts = [x for x in neighbours[v] if x not in after[v].values()]
        for first in starts + neighbours[v]:
            w = first
            while w >= 0 and w not in ring:
                ring.append(w)
                w = after[v].get(w, -1)
        rings.append(ring)
    return rings


def order_of_vertices(
    mixer: Mixer, triangles: list[list[int]], N: int, n_relations: int
) -> list[int]:
    rings = rings_of(triangles, N)

    def seen(v: int, u: int) -> list[int]:
        first = rings[v].index(u) + 1 if u in rings[v] else 0
        return rings[v][first:] + rings[v][:first]

    def lead(v: int, u: int, path: Route) -> int:
        for turn in path:
            if turn >= len(rings[v]):
                return -1
            v, u = seen(v, u)[turn], v
        return v

    def around(v: int, u: int, most: int) -> dict[int, list[int]]:
        """Listed nodes with the nodes that lead to them, themselves the last."""
        listed: dict[int, list[int]] = {v: [v]}
        queue, looks = deque([v]), 0
        while queue:
            w = queue.popleft()
            looks += len(rings[w])
            if looks >= 8 * most:
                break
            for x in seen(w, listed[w][-2] if w != v else u):
                if x not in listed:
                    listed[x] = [*listed[w], x]
                    queue.append(x)
                    if len(listed) > most:
                        return listed
        return listed

    def route(way: list[int], u: int) -> Route:
        turns = []
        for here, there in pairwise(way):
            turns.append(seen(here, u).index(there))
            u = here
        return tuple(turns)

    lone = [v for v in range(N) if not rings[v]]
    node_of: list[int] = []
    vertex: dict[int, int] = {}
    p = o = -1
    h: list[Route | None] = [None] * 4
    remembered: dict[Any, list[tuple[Route, int]]] = defaultdict(list)
    counts: dict[Any, list[int]] = defaultdict(lambda: [1, 1])
    relations: list[list[list[list[int]]]] = []
    outcome = 4

    def trust(source: Any) -> int:
        right, wrong = counts[source]
        return round(1024 * math.log(right + wrong)) - round(1024 * math.log(wrong))

    while len(node_of) < N:
        if lone and mixer.bit("lone", 0):
            vertex[lone[0]] = len(node_of)
            node_of.append(lone.pop(0))
            relations.append([])
            continue
        proposals: dict[int, list[Any]] = {}

        def propose(v: int, source: Any, proposals: dict[int, list[Any]] = proposals) -> None:
            if v >= 0 and v not in vertex:
                proposals.setdefault(v, []).append(source)

        models: list[Any] = []
        if p >= 0:
            taken = tuple(v in vertex for v in seen(p, o))
            models = [h[-1], (h[-2], h[-1]), tuple(h), taken, (taken, h[-1])]
            for k, context in enumerate(models):
                for i, (path, again) in enumerate(remembered[k, context]):
                    propose(lead(p, o, path), (k, i, min(again, 5)))
            for turn, v in enumerate(seen(p, o)):
                propose(v, (5, min(turn, 5), len(rings[p])))
            for j, of_one in enumerate(relations[:-5:-1]):
                for i, steps in enumerate(of_one):
                    for s, ends in enumerate(steps):
                        for v in ends:
                            propose(v, (6 + 4 * j + s, i))
        strength = {v: sum(map(trust, sources)) for v, sources in proposals.items()}
        order = sorted(proposals, key=lambda v: -strength[v])[:16]
        node, outcome_now = -1, 4
        for place, v in enumerate(order):
            B = max(proposals[v], key=trust)
            S, T = min(15, 3 * strength[v] // 1024), sum(w in vertex for w in rings[v][:8])
            if mixer.bit(
                ("here", min(place, 3)),
                B,
                (place, len(proposals[v]), S),
                (B[:2], place, outcome),
                (T, min(len(rings[v]), 15)),
                (S, T),
            ):
                node, outcome_now = v, min(place, 4)
                break
        outcome = outcome_now
        if node < 0:
            free = [v for v in range(N) if rings[v] and v not in vertex]
            if not mixer.bit("far", 0):
                near = [v for v in around(p, o, 400) if v in free]
                node = near[mixer.number("rank", 0)]
            elif N <= 65536:
                node = free[mixer.coded.bits(len(free).bit_length())]
            else:
                node = mixer.coded.bits(N.bit_length())
        for v, sources in proposals.items():
            for source in sources:
                pair = counts[source]
                pair[v != node] += 1
                if sum(pair) > 40:
                    pair[:] = [(n + 1) // 2 for n in pair]
        path_there, origin = None, rings[node][0]
        if p >= 0:
            way = around(p, o, 120).get(node)
            if way:
                path_there, origin = route(way, o), way[-2]
                for k, context in enumerate(models):
                    known = dict(remembered[k, context])
                    again = known.pop(path_there, -1) + 1
                    remembered[k, context] = [(path_there, again), *known.items()][:2]
        h = [*h[1:], path_there]
        found: list[list[list[int]]] = []
        n = len(node_of)
        for v, way in around(node, origin, 40).items():
            m = vertex.get(v, n)
            if m < n - 4 and len(found) < n_relations:
                back = route(way[::-1], -1)
                bases = [node_of[b] if b >= 0 else -1 for b in (m + 1, m - 1, m + 2, m - 2)]
                found.append(
                    [
                        [lead(base, u, back) for u in rings[base][:12]] if base >= 0 else []
                        for base in bases
                    ]
                )
        relations.append(found)
        p, o = node, origin
        vertex[node] = n
        node_of.append(node)
    return node_of


def cells(data: bytes, ends: list[int], grid: list[int]) -> list[list[int]]:
    """Section 10, kind 1."""
    bits = [int(bit) for byte in data[1:] for bit in f"{byte:08b}"]
    counts = [n if e == 1 and n > 2 else n - 1 for n, e in zip(grid, ends, strict=True)]
    found: list[list[list[int]]] = []
    for row, column in np.ndindex(*counts):
        pair = []
        for triangle in range(2):
            steps = bits[1 + 6 * triangle : 7 + 6 * triangle]
            pair.append(
                [
                    (row + steps[2 * i]) % grid[0] * grid[1] + (column + steps[2 * i + 1]) % grid[1]
                    for i in range(3)
                ]
            )
        found.append(pair)
    if bits[0]:
        return [face for pair in found for face in pair]
    return [pair[i] for i in range(2) for pair in found]
