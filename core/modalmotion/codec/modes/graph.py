"""The graph of a mesh: its springs, and patches halved until each is small enough."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from modalmotion.native import run

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
