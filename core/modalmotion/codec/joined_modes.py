"""Modes of a patch, joined from those of its leaves.

The eigenvectors of a whole patch cost the cube of its size. So it is cut into leaves, whose own
modes are cheap; the lowest of them are joined by the eigenvectors of the springs in the space that
they span (Rayleigh and Ritz); and what the modes left over add to the lowest of these, to first
order, is turned into them by a rotation (Cayley). Every step is orthonormal, so that nothing is
lost: the modes are complete, and nearly the eigenvectors where it counts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from modalmotion.numeric.native import run
from modalmotion.representation import Bools, Floats, Ints

TILTED: Final = (1, 2)
"""Of the joined modes: the share that the modes left over are turned into."""

NEAREST: Final = 0.3
"""Of the mean square of the frequencies left over: the least distance that is reckoned with."""


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs within a patch.

    Parameters
    ----------
    a, b : (springs,) int64
        Places of their ends among the vertices of the patch.
    stiffness : (springs,) float64
    """

    a: Ints
    b: Ints
    stiffness: Floats

    def within(self, chosen: Bools, place: Ints) -> "Springs":
        """Take some springs, between other places."""
        return Springs(place[self.a[chosen]], place[self.b[chosen]], self.stiffness[chosen])


@dataclass(frozen=True, eq=False)
class PatchBasis:
    """Orthonormal modes of one patch, by rank.

    Parameters
    ----------
    leaves : list of (n,) int64
        Places of the vertices of each leaf.
    low, high : list of (n, modes) float64
        Modes of each leaf: those that are joined, and those left over.
    ranks : (left over,) int64
        Rank of each mode left over, leaf after leaf, less the number of those joined.
    turn : (joined, joined) float64, optional
        Joined modes in the columns; None for a single leaf.
    tilt : (left over, tilted) float64, optional
        Half of what the modes left over add to the lowest joined ones.
    """

    leaves: Sequence[Ints]
    low: Sequence[Floats]
    high: Sequence[Floats]
    ranks: Ints
    turn: Floats | None = None
    tilt: Floats | None = None

    @property
    def n(self) -> int:
        """Number of vertices, and of modes."""
        return sum(map(len, self.leaves))

    @property
    def n_joined(self) -> int:
        """Number of modes that are joined."""
        return self.n - len(self.ranks)

    def synthesise(self, coefficients: Floats) -> Floats:
        """Coefficients to values, (rows, n) to (rows, n)."""
        lower, upper = coefficients[:, : self.n_joined], coefficients[:, self.n_joined :]
        lower, upper = self._tilted(lower, upper[:, self.ranks], 1.0)
        if self.turn is not None:
            lower = lower @ self.turn.T
        values = np.empty(coefficients.shape)
        at = above = 0
        for leaf, low, high in zip(self.leaves, self.low, self.high, strict=True):
            next_at, next_above = at + low.shape[1], above + high.shape[1]
            values[:, leaf] = lower[:, at:next_at] @ low.T + upper[:, above:next_above] @ high.T
            at, above = next_at, next_above
        return values

    def analyse(self, values: Floats) -> Floats:
        """Values to coefficients, (rows, n) to (rows, n)."""
        lower = [values[:, leaf] @ low for leaf, low in zip(self.leaves, self.low, strict=True)]
        upper = [values[:, leaf] @ high for leaf, high in zip(self.leaves, self.high, strict=True)]
        joined = np.concatenate(lower, axis=1)
        if self.turn is not None:
            joined = joined @ self.turn
        joined, rest = self._tilted(joined, np.concatenate(upper, axis=1), -1.0)
        coefficients = np.empty(values.shape)
        coefficients[:, : self.n_joined] = joined
        coefficients[:, self.n_joined + self.ranks] = rest
        return coefficients

    def _tilted(self, lower: Floats, upper: Floats, direction: float) -> tuple[Floats, Floats]:
        # U = (I + A) / (I - A) of A = [0 -Y'; Y 0], or its inverse, for rows of numbers.
        if self.tilt is None:
            return lower, upper
        Y = direction * self.tilt
        k = Y.shape[1]
        u = np.linalg.solve(self._core, (lower[:, :k] - upper @ Y).T).T
        v = upper + u @ Y.T
        return np.concatenate([2.0 * u - lower[:, :k], lower[:, k:]], axis=1), 2.0 * v - upper

    @cached_property
    def _core(self) -> Floats:
        assert self.tilt is not None  # noqa: S101 - for the type checker
        core: Floats = np.eye(self.tilt.shape[1]) + self.tilt.T @ self.tilt
        return core


def solve_patch(
    leaves: Sequence[Ints], springs: Springs, signs: Floats, n_joined: int, errors: float
) -> PatchBasis:
    """Solve for the modes of a patch.

    Parameters
    ----------
    leaves : list of (n,) int64
        Places of the vertices of each leaf, ascending; the leaves by their lowest.
    springs : Springs
    signs : (vertices,) float64
        The sum over the vertices of these times a mode is positive.
    n_joined : int
        At least one for each leaf; of no meaning for a single one.
    errors : float
        To add to each entry of a matrix, over its largest, to see what they do.
    """
    leaf_of, place = np.empty((2, len(signs)), dtype=np.int64)
    for number, leaf in enumerate(leaves):
        leaf_of[leaf] = number
        place[leaf] = np.arange(len(leaf))
    home = np.where(leaf_of[springs.a] == leaf_of[springs.b], leaf_of[springs.a], -1)
    squares, modes = [], []
    for number, leaf in enumerate(leaves):
        inside = springs.within(home == number, place)
        square, Phi = _eigenvectors(_stiffness_matrix(inside, len(leaf)), errors)
        squares.append(square)
        modes.append(_signed(Phi, signs[leaf]))
    if len(leaves) == 1:
        none = np.zeros(0, dtype=np.int64)
        return PatchBasis(leaves, modes, [Phi[:, :0] for Phi in modes], none)
    counts, ranks = _joined_of(list(map(len, leaves)), n_joined)
    low = [Phi[:, :n] for Phi, n in zip(modes, counts, strict=True)]
    high = [Phi[:, n:] for Phi, n in zip(modes, counts, strict=True)]
    across = _across(springs, leaf_of, place, len(leaves))
    A = across.pulled(low, across.stretched(low, np.eye(n_joined)))
    A[np.diag_indices_from(A)] += _parts(squares, counts, lowest=True)
    found, C = _eigenvectors(A, errors)
    sums = [signs[leaf] @ Phi for leaf, Phi in zip(leaves, low, strict=True)]
    C = _signed(C, np.concatenate(sums))
    k = n_joined * TILTED[0] // TILTED[1]
    left = _parts(squares, counts, lowest=False) + across.own(high)
    if not k or not len(left):
        return PatchBasis(leaves, low, high, ranks, C)
    F = across.pulled(high, across.stretched(low, C[:, :k]))
    distance = np.maximum(left[:, None] - found[:k], NEAREST * float(left.mean()))
    return PatchBasis(leaves, low, high, ranks, C, -0.5 * F / distance)


@dataclass(frozen=True, eq=False)
class _Across:
    """Springs between leaves.

    Parameters
    ----------
    ends : list of ((springs,) int64, (springs,) int64)
        For each leaf: springs that begin and that end in it.
    at : list of ((springs,) int64, (springs,) int64)
        Places in the leaf of these ends.
    stiffness : (springs,) float64
    """

    ends: Sequence[tuple[Ints, Ints]]
    at: Sequence[tuple[Ints, Ints]]
    stiffness: Floats

    def stretched(self, low: Sequence[Floats], turn: Floats) -> Floats:
        """Find the forces of the springs in combinations of modes, (springs, combinations)."""
        force = np.zeros((len(self.stiffness), turn.shape[1]))
        start = 0
        for (a, b), (at_a, at_b), Phi in zip(self.ends, self.at, low, strict=True):
            part = turn[start : start + Phi.shape[1]]
            force[a] += Phi[at_a] @ part
            force[b] -= Phi[at_b] @ part
            start += Phi.shape[1]
        force *= self.stiffness[:, None]
        return force

    def pulled(self, modes: Sequence[Floats], force: Floats) -> Floats:
        """Find what forces of the springs do in the modes of each leaf, (modes, combinations)."""
        parts = [
            Phi[at_a].T @ force[a] - Phi[at_b].T @ force[b]
            for (a, b), (at_a, at_b), Phi in zip(self.ends, self.at, modes, strict=True)
        ]
        return np.concatenate(parts)

    def own(self, modes: Sequence[Floats]) -> Floats:
        """Twice the energy of each mode of each leaf in the springs between, (modes,)."""
        k = self.stiffness
        parts = [
            k[a] @ Phi[at_a] ** 2 + k[b] @ Phi[at_b] ** 2
            for (a, b), (at_a, at_b), Phi in zip(self.ends, self.at, modes, strict=True)
        ]
        return np.concatenate(parts)


def _across(springs: Springs, leaf_of: Ints, place: Ints, n_leaves: int) -> _Across:
    p, q = leaf_of[springs.a], leaf_of[springs.b]
    between = p != q
    p, q = p[between], q[between]
    a, b = place[springs.a[between]], place[springs.b[between]]
    ends = [(np.flatnonzero(p == i), np.flatnonzero(q == i)) for i in range(n_leaves)]
    at = [(a[begins], b[stops]) for begins, stops in ends]
    return _Across(ends, at, springs.stiffness[between])


def _stiffness_matrix(springs: Springs, n: int) -> Floats:
    K = np.zeros((n, n))
    K[springs.a, springs.b] = K[springs.b, springs.a] = -springs.stiffness
    np.fill_diagonal(K, -K.sum(axis=1))
    return K


def _eigenvectors(K: Floats, errors: float) -> tuple[Floats, Floats]:
    if errors:
        noise = np.random.default_rng(len(K)).normal(size=K.shape)
        noise *= errors * float(np.abs(np.diagonal(K)).max(initial=0.0))
        K = K + np.tril(noise) + np.tril(noise, -1).T
    square, Phi = np.linalg.eigh(K)
    return square, Phi


def _signed(Phi: Floats, signs: Floats) -> Floats:
    turned: Floats = Phi * np.where(signs @ Phi < 0, -1.0, 1.0)
    return turned


def _joined_of(sizes: list[int], n_joined: int) -> tuple[list[int], Ints]:
    """How many modes of each leaf are joined, and the ranks of those left over."""
    order = by_rank(sizes)
    leaf = np.repeat(np.arange(len(sizes)), sizes)
    counts = np.bincount(leaf[order[:n_joined]], minlength=len(sizes))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    left = rank >= n_joined
    return counts.tolist(), rank[left] - n_joined


def _parts(squares: Sequence[Floats], counts: Sequence[int], *, lowest: bool) -> Floats:
    parts = (s[:n] if lowest else s[n:] for s, n in zip(squares, counts, strict=True))
    return np.concatenate(list(parts))


def by_rank(sizes: Sequence[int]) -> Ints:
    """Order the modes of several parts by their rank in a part over its size.

    Ranks, not frequencies: the order does not depend on rounding. The lowest mode of every part,
    large or small, comes first.

    Parameters
    ----------
    sizes : sequence of int
        Modes of each part.

    Returns
    -------
    (modes,) int64
        Numbers of the modes, part after part.
    """
    each = np.array(sizes, dtype=np.int64)
    rank = np.arange(int(each.sum())) - np.repeat(np.cumsum(each) - each, each)
    key = (2 * rank + 1) * (1 << 30) // np.repeat(each, each)
    key[rank == 0] = -1
    return np.argsort(key, kind="stable")


def edges_of(faces: Ints) -> Ints:
    """Edges of triangles, each once, smaller vertex first, sorted; no loops."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    n = int(pairs.max(initial=0)) + 1
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    numbers = np.sort((low * n + high)[low != high])
    numbers = numbers[np.diff(numbers, prepend=-1) > 0]
    return np.stack([numbers // n, numbers % n], axis=1)


def stiffness_of(edges: Ints) -> Floats:
    """One, and up to an eighth more, as the two ends decide: no two springs are alike."""
    stiffness: Floats = 1.0 + scatter(edges[:, 0] * 2**20 + edges[:, 1], 0) / 8.0
    return stiffness


def scatter(numbers: Ints, seed: int) -> Floats:
    """Numbers in [0, 1) that look random: the high bits of a product modulo 2^32."""
    mixed = (numbers.astype(np.uint64) + np.uint64(977 * seed + 1)) * np.uint64(2654435761)
    mixed = (mixed ^ (mixed >> np.uint64(15))) * np.uint64(2246822519) & np.uint64(0xFFFFFFFF)
    mixed = (mixed ^ (mixed >> np.uint64(13))) * np.uint64(3266489917) & np.uint64(0xFFFFFFFF)
    return (mixed >> np.uint64(8)).astype(np.float64) / 2.0**24


def patches_of(edges: Ints, n_vertices: int, largest: int) -> list[Ints]:
    """Vertices of each patch, ascending; the patches by their lowest vertex.

    Parameters
    ----------
    edges : (edges, 2) int64
        Each once, no loops.
    n_vertices : int
    largest : int
        Vertices of the largest patch. A connected part with more is cut in two: what is near
        one of its ends, breadth first, and the rest.
    """
    offsets, neighbours = graph_of(edges, n_vertices)
    owner = np.empty(n_vertices, dtype=np.int64)
    room = np.empty(5 * n_vertices + 2, dtype=np.int64)
    run("mm_halve", n_vertices, offsets, neighbours, largest, owner, room)
    order = np.argsort(owner, kind="stable")
    cuts = np.flatnonzero(np.diff(owner[order], prepend=-1, append=-1)).tolist()
    parts = [order[start:stop] for start, stop in pairwise(cuts)]
    return sorted(parts, key=lambda part: int(part[0]))


def graph_of(edges: Ints, n_vertices: int) -> tuple[Ints, Ints]:
    """Where the neighbours of each vertex begin, and the neighbours, ascending."""
    a, b = edges[:, 0], edges[:, 1]
    pairs = np.concatenate([a * n_vertices + b, b * n_vertices + a])
    pairs.sort()
    counts = np.bincount(pairs // n_vertices, minlength=n_vertices)
    return np.concatenate([[0], np.cumsum(counts)]), pairs % n_vertices
