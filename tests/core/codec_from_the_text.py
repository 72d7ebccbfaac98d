"""A decoder made from docs/format.md alone: slow, plain, and without the project's codec."""

from __future__ import annotations

import hashlib
import math
import struct
import zlib
from collections import defaultdict, deque
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
MASK = 2**64 - 1


class Bytes:
    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, n: int) -> bytes:
        self.at += n
        assert self.at <= len(self.data)
        return self.data[self.at - n : self.at]

    def unpack(self, form: str) -> tuple[Any, ...]:
        return struct.unpack("<" + form, self.take(struct.calcsize("<" + form)))

    def byte(self) -> int:
        return self.take(1)[0]

    def varint(self) -> int:
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    def zigzag(self) -> int:
        value = self.varint()
        return value // 2 if value % 2 == 0 else -(value + 1) // 2

    def section(self) -> bytes:
        part = self.take(self.varint())
        assert zlib.crc32(part) == self.unpack("I")[0]
        return part


class Coded:
    """Section 5."""

    def __init__(self, data: bytes) -> None:
        source = Bytes(data)
        n = source.varint()
        self.words = deque(source.unpack(f"{n}I"))
        self.plain = "".join(f"{byte:08b}" for byte in source.data[source.at :])
        self.lower, self.range = 0, MASK
        self.point = self.word() << 32
        self.point |= self.word()

    def word(self) -> int:
        return self.words.popleft() if self.words else 0

    def symbol(self, weights: list[int]) -> int:
        m = len(weights)
        scale = (2**24 - m) / float(sum(weights))
        left = [math.floor(sum(weights[:i]) * scale) + i if i else 0 for i in range(m)] + [2**24]
        unit = self.range >> 24
        quantile = ((self.point - self.lower) & MASK) // unit
        i = next(i for i in range(m) if left[i] <= quantile < left[i + 1])
        self.lower = (self.lower + unit * left[i]) & MASK
        self.range = unit * (left[i + 1] - left[i])
        if self.range < 2**32:
            self.lower = (self.lower << 32) & MASK
            self.range <<= 32
            self.point = ((self.point << 32) | self.word()) & MASK
        return i

    def bits(self, n: int) -> int:
        part, self.plain = self.plain[:n], self.plain[n:]
        return int(part, 2) if n else 0


Table = list[int]


def batch(coded: Coded, tables: list[tuple[Table, Table]]) -> list[int]:
    """Section 6: one magnitude for each pair of tables."""
    small = [coded.symbol(symbols) for symbols, _ in tables]
    for value, (symbols, _) in zip(small, tables, strict=True):
        symbols[value] += 24
    large = [i for i, value in enumerate(small) if value == 15]
    classes = [coded.symbol(tables[i][1]) for i in large]
    for i, n in zip(large, classes, strict=True):
        tables[i][1][n] += 24
    for i, n in zip(large, classes, strict=True):
        small[i] = 14 + 2**n + coded.bits(n)
    return small


def number_list(coded: Coded, count: int) -> list[int]:
    table = (
        [max(1, 24 >> (i // 2)) for i in range(16)],
        [max(1, 8 >> (i // 2)) for i in range(40)],
    )
    found: list[int] = []
    while len(found) < count:
        size = min(max(8, len(found)), count - len(found))
        found += batch(coded, [table] * size)
    return found


def start(context: int) -> tuple[Table, Table]:
    mean = (2 + context % 2) * 2.0 ** (context // 2) * 1.25 / 512
    ratio = mean / (1 + mean)
    symbols, left = [], 1.0
    for _ in range(15):
        symbols.append(1 + math.floor(left * (1 - ratio) * 512))
        left *= ratio
    symbols.append(1 + math.floor(left * 512))
    classes, left, power = [], 1.0, ratio
    for _ in range(40):
        classes.append(1 + math.floor(left * (1 - power) * 256))
        left *= power
        power *= power
    return symbols, classes


def window(m: Array, r: int, c: int, end: int, d: int, k: int) -> int:
    return int(m[r + 3 - d, max(c - k, 0) : min(c + k + 1, end)].sum())


def band_ends(C: int) -> list[int]:
    ends: list[int] = []
    width = 4
    while not ends or ends[-1] < C:
        ends.append(min(C, (ends[-1] if ends else 0) + width))
        if len(ends) % 2 == 0:
            width = min(64, 2 * width)
    return ends


def matrix(coded: Coded, R: int, C: int) -> Array:
    """Section 7."""
    q = np.zeros((R, C), dtype=np.int64)
    if not R or not C:
        return q
    ends = band_ends(C)
    B = len(ends)
    begins = [0, *ends[:-1]]
    extents = B - np.cumsum(number_list(coded, R))
    tables = [start(k) for k in range(44)]
    tiles: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for r in range(R):
        if extents[r] <= 0:
            break
        for j in range(extents[r]):
            tiles[j + r].append((r, j))
    m = np.zeros((R + 3, C), dtype=np.int64)

    def left_band(r: int, j: int) -> int:
        if j < 0:
            return 0
        part = m[r + 3, begins[j] : ends[j]]
        return int(64 * part.sum() // len(part))

    for t in sorted(tiles):
        places, chosen = [], []
        for r, j in sorted(tiles[t]):
            for c in range(begins[j], ends[j]):
                S = partial(window, m, r, c, ends[j])
                expected = (
                    3 * left_band(r, j - 1) + left_band(r, j - 2) + 60 * S(1, 0)
                    + 24 * S(1, 1) + 12 * S(2, 1) + 14 * S(3, 1)
                    + 8 * S(1, 6) + 5 * S(2, 6) + 5 * S(3, 6) + S(1, 32)
                )  # fmt: skip
                v = expected + 2
                n = v.bit_length() - 1
                places.append((r, c))
                chosen.append(tables[min(2 * n - 2 + ((v >> (n - 1)) & 1), 43)])
        for (r, c), magnitude in zip(places, batch(coded, chosen), strict=True):
            q[r, c] = magnitude
            m[r + 3, c] = min(magnitude, 1023)
        for place in places:
            if q[place] and coded.bits(1):
                q[place] = -q[place]
    return q


def dct2(n: int) -> Array:
    i, r = np.arange(n), np.arange(n)[:, None]
    waves = np.cos(np.pi * r * (2 * i + 1) / 2 / n)
    rows: Array = np.where(r == 0, np.sqrt(1 / n), np.sqrt(2 / n)) * waves
    return rows


def fourier(n: int) -> Array:
    i = np.arange(n)
    rows = [np.full(n, 1 / np.sqrt(n))]
    for r in range(1, n):
        p = (r + 1) // 2
        if n % 2 == 0 and r == n - 1:
            rows.append((-1.0) ** i / np.sqrt(n))
        else:
            wave = np.cos if r % 2 else np.sin
            rows.append(np.sqrt(2 / n) * wave(2 * np.pi * p * i / n))
    return np.array(rows)


def lattice_modes(source: Bytes) -> Array:
    """Section 4, kind 1: (modes, vertices)."""
    axes = [(source.byte(), source.byte(), source.varint()) for _ in range(source.byte())]
    rows, keys = [], []
    for numbers in np.ndindex(*(n for _, _, n in axes)):
        shape, key = np.ones(1), 0
        for axis, (r, (ends, w, n)) in enumerate(zip(numbers, axes, strict=True)):
            i = np.arange(n)
            odd = axis + 1 < len(axes) and (numbers[axis + 1] + 1) // 2 % 2 == 1
            if ends == 1:
                along, h = fourier(n)[r], 4 * ((r + 1) // 2)
            elif ends == 2 and odd:
                along = np.sqrt(2 / n) * np.sin(np.pi * (2 * r + 1) * (2 * i + 1) / 4 / n)
                h = 2 * r + 1
            elif ends == 3 and odd:
                c = np.sqrt((1 if r == n - 1 else 2) / n)
                along, h = c * np.sin(np.pi * (r + 1) * (2 * i + 1) / 2 / n), 2 * r + 2
            else:
                along, h = dct2(n)[r], 2 * r
            shape = np.multiply.outer(shape, along).ravel()
            key += (w * h) ** 2
        rows.append(shape)
        keys.append(key)
    return np.array(rows)[np.argsort(keys, kind="stable")]


def g(x: int, s: int) -> float:
    y = ((x + 977 * s + 1) * 2654435761) % 2**64
    y = ((y ^ (y >> 15)) * 2246822519) % 2**64 % 2**32
    y = ((y ^ (y >> 13)) * 3266489917) % 2**64 % 2**32
    return (y >> 8) / 2**24


def breadth_first(neighbours: dict[int, set[int]], first: int) -> list[int]:
    order, seen = [first], {first}
    for v in order:
        for w in sorted(neighbours[v]):
            if w not in seen:
                seen.add(w)
                order.append(w)
    return order


def patches_of(vertices: set[int], edges: set[tuple[int, int]], P: int) -> list[list[int]]:
    neighbours: dict[int, set[int]] = {v: set() for v in vertices}
    for a, b in edges:
        if a in vertices and b in vertices:
            neighbours[a].add(b)
            neighbours[b].add(a)
    found, left = [], set(vertices)
    while left:
        order = breadth_first(neighbours, min(left))
        left -= set(order)
        if len(order) <= P:
            found.append(sorted(order))
            continue
        order = breadth_first(neighbours, order[-1])
        for side in (order[: len(order) // 2], order[len(order) // 2 :]):
            found += patches_of(set(side), edges, P)
    return sorted(found)


def spring_modes(source: Bytes, N: int, faces: list[list[int]]) -> Array:
    """Section 4, kind 2: (modes, vertices)."""
    seed, P = source.byte(), source.varint()
    probe = source.unpack("8h")
    edges = {
        (min(a, b), max(a, b))
        for face in faces
        for a, b in zip(face, face[1:] + face[:1], strict=True)
        if a != b
    }
    entries, largest = [], np.zeros((0, 0))
    for number, patch in enumerate(patches_of(set(range(N)), edges, P)):
        n = len(patch)
        where = {v: i for i, v in enumerate(patch)}
        K = np.zeros((n, n))
        for a, b in edges:
            if a in where and b in where:
                k = 1 + g(a * 2**20 + b, seed) / 8
                K[where[a], where[b]] -= k
                K[where[b], where[a]] -= k
        K -= np.diag(K.sum(axis=1))
        V = np.linalg.eigh(K)[1]
        V = V * np.sign(np.array([g(v, seed + 1) - 0.5 for v in patch]) @ V)
        if n > len(largest):
            largest = V
        for k in range(n):
            mode = np.zeros(N)
            mode[patch] = V[:, k]
            key = -1 if k == 0 else (2 * k + 1) * 2**30 // n
            entries.append(((key, number, k), mode))
    n = len(largest)
    for j, value in enumerate(probe):
        assert abs(largest[(7919 * j + 11) % n, n * j // 8] * 4096 - value) <= 1.5
    return np.array([mode for _, mode in sorted(entries, key=lambda entry: entry[0])])


class Answers:
    """Section 8."""

    def __init__(self, coded: Coded) -> None:
        self.coded = coded
        self.counts: dict[Any, list[int]] = defaultdict(lambda: [0, 0])
        self.weights: dict[Any, list[int]] = {}

    def ask(self, question: Any, *contexts: Any) -> bool:
        keys = [(question, place, context) for place, context in enumerate(contexts)]
        weights = self.weights.setdefault(question, [22938] * len(keys))

        def log(n: int) -> int:
            return round(256 * math.log(n + 0.4))

        x = [log(self.counts[key][1]) - log(self.counts[key][0]) for key in keys]
        d = sum(w * v for w, v in zip(weights, x, strict=True)) >> 16
        chance = round(65536 / (1 + math.exp(-max(-2047, min(2047, d)) / 256)))
        yes = self.coded.symbol([65536 - chance, chance]) == 1
        e = 3 * ((65536 if yes else 0) - chance)
        for place, key in enumerate(keys):
            weights[place] += (x[place] * e) >> 16
            pair = self.counts[key]
            pair[yes] += 1
            if pair[not yes] > 2:
                pair[not yes] = (pair[not yes] + 2) // 2
            if sum(pair) > 250:
                pair[:] = [pair[0] // 2, pair[1] // 2]
        return yes

    def number(self, question: Any, *contexts: Any) -> int:
        n = 0
        while self.ask(question, *((c, n) for c in contexts)):
            n += 1
        return (1 << n) - 1 + self.coded.bits(n)


def centred(m: Array, y: int, x: int, d: int, k: int) -> int:
    return int(m[y - d, x - k : x + k + 1].sum())


def mixed_matrix(coded: Coded, R: int, C: int) -> Array:
    """Section 9."""
    q = np.zeros((R, C), dtype=np.int64)
    if not R or not C:
        return q
    ends = band_ends(C)
    extents = np.maximum(len(ends) - np.cumsum(number_list(coded, R)), 0)
    answers = Answers(coded)
    m = np.zeros((R + 6, C + 80), dtype=np.int64)

    def z(v: int) -> int:
        u = int(v) + 2
        n = u.bit_length() - 1
        return 2 * n - 2 + ((u >> (n - 1)) & 1)

    for r in range(R):
        for c in range(ends[extents[r] - 1] if extents[r] else 0):
            x, y = c + 40, r + 6

            S = partial(centred, m, y, x)
            W, V = int(m[y, x - 8 : x].sum()), int(m[y, x - 30 : x].sum())
            up = [int(m[y - d, x]) for d in range(7)]
            first = z(
                60 * up[1] + 24 * S(1, 1) + 12 * S(2, 1) + 14 * S(3, 1)
                + 8 * S(1, 6) + 5 * S(2, 6) + 5 * S(3, 6) + 32 * W
            )  # fmt: skip
            contexts = (
                first,
                (z(4 * W), z(2 * S(1, 6))),
                (z(up[1]), z(up[2]), z(up[3])),
                (z(S(1, 1)), z(S(3, 1))),
                (z(V), z(W)),
                (min(c, 60), r % 3),
                (z(m[y, x - 1]), z(m[y, x - 2]), z(up[1])),
                (z(S(1, 6) + S(2, 6) + S(3, 6)), z(up[6])),
            )
            a = 0
            while a < 14 and answers.ask(("more than", a), *contexts):
                a += 1
            if a == 14:
                a += answers.number("larger", 0, first)
            q[r, c] = a
            m[y, x] = min(a, 1023)
    for place in zip(*np.nonzero(q), strict=True):
        if coded.bits(1):
            q[place] = -q[place]
    return q


def walk(data: bytes, M: int, N: int) -> list[list[int]]:
    """Section 10, kind 0."""
    answers = Answers(Coded(data[3:]))
    triangles, n_met = walk_triangles(answers, data[1], M)
    node_of = order_of_vertices(answers, triangles, N, data[2])
    vertex_of = {node: vertex for vertex, node in enumerate(node_of)}
    assert sorted(vertex_of) == list(range(N))
    assert n_met <= N
    return [[vertex_of[node] for node in face] for face in triangles]


def walk_triangles(answers: Answers, period: int, M: int) -> tuple[list[list[int]], int]:
    used, pivots, n_met = list[int](), deque[int](), 0
    ahead: dict[int, list[int]] = defaultdict(list)
    behind: dict[int, list[int]] = defaultdict(list)
    around: dict[int, int] = defaultdict(int)
    codes, in_role = (0,) * 6, dict[int, int]()
    faces: list[list[int]] = []

    def drop() -> None:
        while pivots and not ahead[pivots[0]]:
            pivots.popleft()

    face: list[int] = []
    kinds = 0
    while len(faces) < M:
        corner = len(face)
        role = 3 * (len(faces) % period) + corner
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
            (role, kinds, codes[-3:]),
            (role, kinds, codes),
            (kinds, a, b, y),
            (kinds, a, y, codes[-2:]),
            (kinds, a, codes[-1]),
            (kinds, a, b),
            (role, kinds, in_role.get(role, 0)),
        )
        kind = 3
        for asked in ((1, 2, 0), (1, 0, 2), (0, 2, 1))[corner]:
            if asked in named and answers.ask((corner, asked), *contexts):
                kind = asked
                break
        if kind == 2 and not corner:
            pivots.popleft()
            drop()
            codes = (*codes[1:], 64)
            continue
        v = used[-1 - answers.number("older", corner, role)] if kind == 3 else named[kind]
        if kind == 0:
            n_met += 1
            pivots.append(v)
        else:
            used.remove(v)
        used.append(v)
        face.append(v)
        in_role[role] = kind
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
    answers: Answers, triangles: list[list[int]], N: int, n_relations: int
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
    distance = [6] * N
    p = o = -1
    h: list[Route | None] = [None] * 4
    D = [6] * 4
    remembered: dict[Any, list[tuple[Route, int]]] = defaultdict(list)
    counts: dict[Any, list[int]] = defaultdict(lambda: [1, 1])
    relations: list[list[list[list[int]]]] = []
    outcome = 4

    def trust(source: Any) -> int:
        right, wrong = counts[source]
        return round(1024 * math.log(right + wrong)) - round(1024 * math.log(wrong))

    while len(node_of) < N:
        if lone and answers.ask("lone", 0):
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
        order = sorted(proposals, key=lambda v: -strength[v] - 2048 * (distance[v] == D[-1]))[:16]
        node, outcome_now = -1, 4
        for place, v in enumerate(order):
            B = max(proposals[v], key=trust)
            S, d = min(15, 3 * strength[v] // 1024), distance[v]
            if answers.ask(
                ("here", min(place, 3)),
                B,
                (place, len(proposals[v]), S),
                (B[:2], place, outcome),
                (d, D[-1], D[-2]),
                (S, d == D[-1], d == D[-4]),
            ):
                node, outcome_now = v, min(place, 4)
                break
        outcome = outcome_now
        if node < 0:
            d = 1
            while d < 6 and not answers.ask("distance", (d, D[-1]), (d, D[-1], D[-2]), (d, D[-4])):
                d += 1
            free = [v for v in range(N) if rings[v] and v not in vertex]
            if not answers.ask("far", 0):
                near = [v for v in around(p, o, 400) if v in free and distance[v] == d]
                node = [v for v in near if v not in order][answers.number("rank", d)]
            elif N <= 65536:
                alike = [v for v in free if distance[v] == d]
                node = alike[answers.coded.bits(len(alike).bit_length())]
            else:
                node = answers.coded.bits(N.bit_length())
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
        h, D = [*h[1:], path_there], [*D[1:], distance[node]]
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
        distance[node], row = 0, deque([node])
        while row:
            v = row.popleft()
            for w in rings[v]:
                if distance[w] > distance[v] + 1:
                    distance[w] = distance[v] + 1
                    row.append(w)
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


def block(data: bytes, f: int, N: int, modes: Array, form: str) -> Any:
    """Section 11."""
    source = Bytes(data)
    digest = source.take(8)
    kind, step = source.unpack("Bf")
    shifts = (0, *source.unpack("3b"))
    exponent = source.zigzag()
    origin = np.array([source.zigzag() for _ in range(3)])
    width, rows, n_modes, n_components = (source.varint() for _ in range(4))
    read_matrix = mixed_matrix if source.byte() else matrix
    coded = Coded(source.data[source.at :])
    components = read_matrix(coded, n_components, (3 * f if kind == 3 else f) if kind > 1 else 0)
    coefficients = read_matrix(coded, rows, n_modes)

    def values(q: Array) -> Array:
        shift = np.array([shifts[min(abs(int(n)), 3)] for n in q.ravel()]).reshape(q.shape)
        found: Array = np.sign(q) * (np.abs(q) - shift / 256) * step
        return found

    over_space = values(coefficients) @ modes[:n_modes]
    positions = np.zeros((f, 3, N))
    fixed = (dct2 if kind != 1 else fourier)(f)[: rows // 3 if kind < 2 else 1]
    for c, component in enumerate(fixed):
        positions += component[:, None, None] * over_space[3 * c : 3 * c + 3]
    learned = values(components)
    for c, component in enumerate(learned):
        norm = math.sqrt((component**2).sum())
        component = component / (norm or 1.0)
        turned = dct2(f).T @ component.reshape(f, -1)
        if kind == 2:
            positions += turned[:, :, None] * over_space[3 + 3 * c : 6 + 3 * c]
        else:
            positions += turned[:, :, None] * over_space[3 + c]
    n_values = positions.size
    whole = np.rint(positions).astype(np.int64).ravel()
    n_guards = number_list(coded, 1)[0]
    places = [coded.bits(max(1, n_values.bit_length())) for _ in range(n_guards)]
    for place in places:
        whole[place] = math.floor(positions.ravel()[place]) + coded.bits(1)
    if width:
        n = number_list(coded, 1)[0]
        place, gaps = -1, number_list(coded, n)
        sizes = number_list(coded, n)
        for gap, size in zip(gaps, sizes, strict=True):
            place += gap + 1
            whole[place] += (-1 if coded.bits(1) else 1) * (size + 1) * width
    total = whole.reshape(f, 3, N).transpose(0, 2, 1) + origin
    vertices = np.ldexp(total.astype(np.float64), exponent).astype(form)
    assert hashlib.sha256(np.ascontiguousarray(vertices).tobytes()).digest()[:8] == digest
    return vertices


def decode_from_the_text(data: bytes) -> tuple[Any, list[list[int]]]:
    """Vertices and faces of a stream."""
    source = Bytes(data)
    assert source.take(5) == b"MMSQ\x02"
    header = Bytes(source.section())
    F, N, M = (header.varint() for _ in range(3))
    form = "<f8" if header.byte() else "<f4"
    header.byte()
    ends = list(header.take(header.byte()))
    grid = [header.varint() for _ in range(header.byte())]
    times = header.byte()
    header.take({0: 0, 1: 16}[times] if times < 2 else header.varint())
    named = Bytes(header.take(header.varint()))
    header.unpack("3f")
    frames = [header.varint() for _ in range(header.varint())]
    assert sum(frames) == F
    section = source.section()
    faces: list[list[int]] = []
    if M:
        faces = cells(section, ends, grid) if section[0] else walk(section, M, N)
    kind = named.byte()
    modes = lattice_modes(named) if kind == 1 else spring_modes(named, N, faces)
    parts = [block(source.section(), f, N, modes, form) for f in frames]
    assert source.at == len(data)
    return np.concatenate(parts), faces
