"""Numbers and matrices of a stream, read from docs/format.md alone: sections 5 to 9."""

from __future__ import annotations

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


class Mixer:
    """Section 8."""

    def __init__(self, coded: Coded) -> None:
        self.coded = coded
        self.counts: dict[Any, list[int]] = defaultdict(lambda: [0, 0])
        self.weights: dict[Any, list[int]] = {}

    def bit(self, kind: Any, *contexts: Any) -> bool:
        keys = [(kind, place, context) for place, context in enumerate(contexts)]
        weights = self.weights.setdefault(kind, [22938] * len(keys))

        def log(n: int) -> int:
            return round(256 * math.log(n + 0.4))

        x = [log(self.counts[key][1]) - log(self.counts[key][0]) for key in keys]
        d = sum(w * v for w, v in zip(weights, x, strict=True)) >> 16
        chance = round(65536 / (1 + math.exp(-max(-2047, min(2047, d)) / 256)))
        one = self.coded.symbol([65536 - chance, chance]) == 1
        e = 3 * ((65536 if one else 0) - chance)
        for place, key in enumerate(keys):
            weights[place] += (x[place] * e) >> 16
            pair = self.counts[key]
            pair[one] += 1
            if pair[not one] > 2:
                pair[not one] = (pair[not one] + 2) // 2
            if sum(pair) > 250:
                pair[:] = [pair[0] // 2, pair[1] // 2]
        return one

    def number(self, kind: Any, *contexts: Any) -> int:
        n = 0
        while self.bit(kind, *((c, n) for c in contexts)):
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
    mixer = Mixer(coded)
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
            while a < 14 and mixer.bit(("more than", a), *contexts):
                a += 1
            if a == 14:
                a += mixer.number("larger", 0, first)
            q[r, c] = a
            m[y, x] = min(a, 1023)
    for place in zip(*np.nonzero(q), strict=True):
        if coded.bits(1):
            q[place] = -q[place]
    return q
