"""Springs: the edges of a mesh, and how stiff each is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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


def stiffness_of(edges: Ints, seed: int) -> Floats:
    """One, and up to an eighth more, as the two ends decide: no two springs are alike."""
    stiffness: Floats = 1.0 + scatter(edges[:, 0] * 2**20 + edges[:, 1], seed) / 8.0
    return stiffness


def scatter(numbers: Ints, seed: int) -> Floats:
    """Numbers in [0, 1) that look random: the high bits of a product modulo 2^32."""
    mixed = (numbers.astype(np.uint64) + np.uint64(977 * seed + 1)) * np.uint64(2654435761)
    mixed = (mixed ^ (mixed >> np.uint64(15))) * np.uint64(2246822519) & np.uint64(0xFFFFFFFF)
    mixed = (mixed ^ (mixed >> np.uint64(13))) * np.uint64(3266489917) & np.uint64(0xFFFFFFFF)
    return (mixed >> np.uint64(8)).astype(np.float64) / 2.0**24
