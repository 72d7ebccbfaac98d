"""Modes of pairs: vertices merged two by two, without any eigenproblem.

A transform that takes a few sums and products for each number: the mean of each pair, and what
the difference within it is more than the means around the pair let expect. Nearly orthonormal,
and not as smooth as spring modes: more bits, and a decoder that needs no linear algebra.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.modes.graph import edges_of, graph_of
from modalmotion.native import run

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PAIRS: Final = 4
"""First byte of the section of these modes."""

EXPECTED_UNIT: Final = 1.0 / 128.0
AT_ONCE: Final = 1 << 16
FEWEST: Final = 16
"""A level has a pair for each so many nodes, at least."""


@dataclass(frozen=True, eq=False)
class Level:
    """Nodes that are merged in pairs.

    Parameters
    ----------
    parent : (nodes,) int64
        Node of the next level.
    a, b : (pairs,) int64
        Lower and higher member of each pair.
    weight : (nodes,) int64
        Vertices of each node.
    beside : (entries,) int64
        Nodes of the next level beside the members: of all a, then of all b.
    starts : (2 x pairs,) int64
        Where those of each member begin; at least one each.
    """

    parent: Ints
    a: Ints
    b: Ints
    weight: Ints
    beside: Ints
    starts: Ints

    def expected(self, means: Floats) -> Floats:
        """Differences within the pairs that the means around them let expect, (pairs, rows)."""
        ends = np.append(self.starts, len(self.beside))
        around = np.empty((len(self.starts), means.shape[1]))
        # So many members at once as a cache holds.
        n_each = max(1, AT_ONCE * len(self.starts) // (len(self.beside) * means.shape[1]))
        for first in range(0, len(around), n_each):
            cuts = ends[first : first + n_each + 1]
            beside = means[self.beside[cuts[0] : cuts[-1]]]
            around[first : first + n_each] = np.add.reduceat(beside, cuts[:-1] - cuts[0])
        around /= np.diff(ends)[:, None]
        n = len(self.a)
        return around[n:] - around[:n]

    @property
    def shares(self) -> tuple[Floats, Floats]:
        """Share of the other one in the weight of a pair, for a and for b, (pairs, 1)."""
        p, q = self.weight[self.a, None], self.weight[self.b, None]
        return q / (p + q), p / (p + q)

    @property
    def scale(self) -> Floats:
        """Coefficient of a unit of difference, (pairs, 1)."""
        p, q = self.weight[self.a, None], self.weight[self.b, None]
        return np.sqrt(p * q / (p + q))


@dataclass(frozen=True, eq=False)
class PairModes:
    """A transform by pairs, coarse differences first.

    Parameters
    ----------
    levels : list of Level
        The finest first.
    roots : (roots,) int64
        Vertices of each node that is left.
    expected : (levels,) uint8
        How much of what is expected is taken, in 1/128.
    """

    levels: list[Level]
    roots: Ints
    expected: NDArray[np.uint8]

    @property
    def shaken(self) -> None:
        """None: no solver decides these modes."""
        return

    def analyse(self, values: Floats) -> Floats:
        """Values at the vertices to coefficients, (rows, vertices) to (rows, modes)."""
        means, parts = values.T, []
        for level, taken in zip(self.levels, self.expected, strict=True):
            difference, above = _merged(level, means)
            difference -= taken * EXPECTED_UNIT * level.expected(above)
            parts.append(level.scale * difference)
            means = above
        parts.append(np.sqrt(self.roots)[:, None] * means)
        return np.concatenate(parts[::-1]).T

    def synthesise(self, coefficients: Floats, where: Ints | None = None) -> Floats:
        """Coefficients to values, (rows, first modes) to (rows, vertices), or some of these."""
        n_rows, n_modes = coefficients.shape
        n = len(self.levels[0].parent) if self.levels else len(self.roots)
        full = np.zeros((n, n_rows))
        full[:n_modes] = coefficients.T
        at = len(self.roots)
        means = full[:at] / np.sqrt(self.roots)[:, None]
        for level, taken in zip(self.levels[::-1], self.expected[::-1], strict=True):
            difference = full[at : at + len(level.a)] / level.scale
            difference += taken * EXPECTED_UNIT * level.expected(means)
            at += len(level.a)
            means = means[level.parent]
            of_a, of_b = level.shares
            means[level.a] -= of_a * difference
            means[level.b] += of_b * difference
        return np.ascontiguousarray((means if where is None else means[where]).T)

    def pieces(self, largest: int) -> None:
        """None: they have no pieces."""

    def write(self) -> bytes:
        """Write which modes these are."""
        return bytes([PAIRS]) + self.expected.tobytes()


def fitted_pairs(faces: Ints, values: Floats) -> PairModes:
    """Make the pairs of a mesh, and see how much of what is expected holds.

    Parameters
    ----------
    faces : (faces, 3) int64
    values : (rows, vertices) float64
    """
    levels, roots = _merge(edges_of(faces), values.shape[1])
    means, taken = values.T, []
    for level in levels:
        difference, above = _merged(level, means)
        expected = level.scale * level.expected(above)
        square = float((expected**2).sum())
        share = float((expected * level.scale * difference).sum()) / square if square > 0 else 0.0
        taken.append(int(np.clip(np.rint(share / EXPECTED_UNIT), 0, 255)))
        means = above
    return PairModes(levels, roots, np.array(taken, dtype=np.uint8))


def read_pair_modes(data: bytes, n_vertices: int, faces: Ints) -> PairModes:
    """Make the pairs that `PairModes.write` wrote.

    Raises
    ------
    ValueError
        If there are other levels.
    """
    levels, roots = _merge(edges_of(faces), n_vertices)
    if len(data) != 1 + len(levels):
        raise ValueError
    return PairModes(levels, roots, np.frombuffer(data, np.uint8, offset=1))


def _merged(level: Level, means: Floats) -> tuple[Floats, Floats]:
    """Differences within the pairs, and the means of the next level."""
    difference = means[level.b] - means[level.a]
    first = np.ones(len(level.parent), dtype=bool)
    first[level.b] = False
    above = means.copy()
    above[level.a] += level.shares[0] * difference
    return difference, above[first]


def _merge(edges: Ints, n_vertices: int) -> tuple[list[Level], Ints]:
    """Merge nodes in pairs, level by level, as long as many find a mate."""
    levels = []
    weight = np.ones(n_vertices, dtype=np.int64)
    while len(edges):
        offsets, neighbours = graph_of(edges, len(weight))
        mate = _mates(offsets, neighbours, weight)
        a = np.flatnonzero(mate > np.arange(len(mate)))
        if FEWEST * len(a) < len(weight):
            break
        b = mate[a]
        first = np.ones(len(weight), dtype=bool)
        first[b] = False
        parent = np.cumsum(first) - 1
        parent[b] = parent[a]
        members = np.concatenate([a, b])
        levels.append(_level(parent, a, b, weight, offsets, neighbours, members))
        above = weight.copy()
        above[a] += weight[b]
        weight = above[first]
        edges = _edges_above(parent[edges], len(weight))
    return levels, weight


def _level(
    parent: Ints, a: Ints, b: Ints, weight: Ints, offsets: Ints, neighbours: Ints, members: Ints
) -> Level:
    counts = np.diff(offsets)[members]
    ends = np.cumsum(counts)
    which = np.repeat(np.arange(len(members)), counts)
    entries = offsets[members][which] + np.arange(int(ends[-1])) - (ends - counts)[which]
    beside, own = parent[neighbours[entries]], parent[members]
    other = beside != own[which]
    which, beside = which[other], beside[other]
    # Who has no neighbour but its mate expects what its own parent has.
    alone = np.flatnonzero(np.bincount(which, minlength=len(members)) == 0)
    which, beside = np.concatenate([which, alone]), np.concatenate([beside, own[alone]])
    order = np.argsort(which, kind="stable")
    starts = np.searchsorted(which[order], np.arange(len(members)))
    return Level(parent, a, b, weight, beside[order], starts)


def _edges_above(pairs: Ints, n: int) -> Ints:
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    numbers = np.sort((low * n + high)[low != high])
    numbers = numbers[np.diff(numbers, prepend=-1) > 0]
    return np.stack([numbers // n, numbers % n], axis=1)


def _mates(offsets: Ints, neighbours: Ints, weight: Ints) -> Ints:
    """Mate of each node, itself where there is none."""
    mates = np.empty_like(weight)
    run("mm_pair", len(weight), offsets, neighbours, weight, mates)
    return mates
