"""A decoder made from docs/format.md alone: slow, plain, and without the project's codec."""

from __future__ import annotations

import hashlib
import math
import struct
import zlib
from collections import defaultdict, deque
from functools import partial
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


def matrix(coded: Coded, R: int, C: int) -> Array:
    """Section 7."""
    q = np.zeros((R, C), dtype=np.int64)
    if not R or not C:
        return q
    ends: list[int] = []
    width = 4
    while not ends or ends[-1] < C:
        ends.append(min(C, (ends[-1] if ends else 0) + width))
        if len(ends) % 2 == 0:
            width = min(64, 2 * width)
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


def walk(data: bytes, M: int, N: int) -> list[list[int]]:
    """Section 8, kind 0."""
    rule = data[1]
    coded = Coded(data[2:])
    period = (1, 2, 8)[rule]
    tables: dict[tuple[int, bool], Table] = {}

    def symbol(context: int, is_class: bool) -> int:
        size = 40 if is_class else 64
        weights = tables.setdefault(
            (context, is_class), [1 + (64 >> (i // 2 + 2)) for i in range(size)]
        )
        value: int = coded.symbol(weights)
        weights[value] += 96
        return value

    def number(context: int) -> int:
        value = symbol(context, False)
        if value < 63:
            return value
        n = symbol(context, True)
        return 62 + (1 << n) + coded.bits(n)

    def signed(value: int) -> int:
        return value // 2 if value % 2 == 0 else -(value + 1) // 2

    unused, used, pivots = list(range(N)), list[int](), deque[int]()
    ahead: dict[int, list[int]] = defaultdict(list)
    behind: dict[int, list[int]] = defaultdict(list)
    kinds, last_of_role, last_new = (3, 3), dict[int, int](), 0
    faces: list[list[int]] = []

    def rank(v: int) -> int:
        return sum(u < v for u in unused)

    def drop() -> None:
        while pivots and not ahead[pivots[0]]:
            pivots.popleft()

    while len(faces) < M:
        face: list[int] = []
        while len(face) < 3:
            role = 3 * (len(faces) % period) + len(face)
            a = number(16 * role + 4 * kinds[0] + kinds[1])
            kinds = (min(a, 3), kinds[0])
            if a == 2 and not face:
                pivots.popleft()
                drop()
                continue
            if a == 0 and rule == 0:
                candidates: list[int] = []
                for v in used[:-49:-1]:
                    above, below = [u for u in unused if u > v], [u for u in unused if u < v]
                    candidates += [u for u in (above[:1] + below[-1:]) if u not in candidates]
                place = number(2**20 + 1)
                if place:
                    v = candidates[place - 1]
                else:
                    v = unused[rank(used[-1] if used else 0) + signed(number(2**20 + 2))]
            elif a == 0:
                before = last_of_role.get(role, last_new)
                v = unused[rank(before) + signed(number(2**20 + 2 + role))]
            elif a == 1:
                v = ahead[face[-1]][-1] if face else pivots[0]
            elif a == 2:
                v = behind[face[0]][-1]
            else:
                v = used[-1 - (a - 3)]
            if a == 0:
                unused.remove(v)
                pivots.append(v)
                last_new = last_of_role[role] = v
            else:
                used.remove(v)
            used.append(v)
            face.append(v)
        for x, y in zip(face, face[1:] + face[:1], strict=True):
            if y in ahead[x]:
                ahead[x].remove(y)
                behind[y].remove(x)
            else:
                ahead[y].append(x)
                behind[x].append(y)
        drop()
        faces.append(face)
    return faces


def cells(data: bytes, ends: list[int], grid: list[int]) -> list[list[int]]:
    """Section 8, kind 1."""
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
    """Section 9."""
    source = Bytes(data)
    digest = source.take(8)
    kind, step = source.unpack("Bf")
    shifts = (0, *source.unpack("3b"))
    exponent = source.zigzag()
    origin = np.array([source.zigzag() for _ in range(3)])
    width, rows, n_modes, n_components = (source.varint() for _ in range(4))
    coded = Coded(source.data[source.at :])
    components = matrix(coded, n_components, (3 * f if kind == 3 else f) if kind > 1 else 0)
    coefficients = matrix(coded, rows, n_modes)

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
    assert source.take(5) == b"MMSQ\x01"
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
