"""Modes of a stream, computed from docs/format.md alone: section 4."""

from __future__ import annotations

import numpy as np
from text_of_numbers import Array, Bytes

Edges = set[tuple[int, int]]


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


def patches_of(vertices: set[int], edges: Edges, P: int) -> list[list[int]]:
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


def stiffness_matrix(vertices: list[int], edges: Edges) -> Array:
    where = {v: i for i, v in enumerate(vertices)}
    K = np.zeros((len(vertices), len(vertices)))
    for a, b in edges:
        if a in where and b in where:
            k = 1 + g(a * 2**20 + b, 0) / 8
            K[where[a], where[b]] -= k
            K[where[b], where[a]] -= k
    K -= np.diag(K.sum(axis=1))
    return K


def signed(V: Array, vertices: list[int]) -> Array:
    turned: Array = V * np.sign(np.array([g(v, 1) - 0.5 for v in vertices]) @ V)
    return turned


def key(k: int, n: int) -> int:
    return -1 if k == 0 else (2 * k + 1) * 2**30 // n


def joined(patch: list[int], edges: Edges, Q: int, share: int) -> Array:
    """Modes of a patch in the columns, from those of its leaves."""
    within = {(a, b) for a, b in edges if a in patch and b in patch}
    leaves = patches_of(set(patch), within, Q)
    n, entries = len(patch), []
    for number, leaf in enumerate(leaves):
        s, V = np.linalg.eigh(stiffness_matrix(leaf, within))
        for k in range(len(leaf)):
            mode = np.zeros(n)
            mode[[patch.index(v) for v in leaf]] = signed(V, leaf)[:, k]
            entries.append(((key(k, len(leaf)), number, k), mode))
    basis = np.array([mode for _, mode in sorted(entries, key=lambda entry: entry[0])]).T
    if len(leaves) == 1:
        return basis
    m = max(len(leaves), n * share // 256)
    K = stiffness_matrix(patch, within)
    w, C = np.linalg.eigh(basis[:, :m].T @ K @ basis[:, :m])
    low, high = signed(basis[:, :m] @ C, patch), basis[:, m:]
    t = m // 2
    if not t or m == n:
        return np.concatenate([low, high], axis=1)
    s = np.diag(high.T @ K @ high)
    Y = -(high.T @ K @ low[:, :t]) / 2 / np.maximum(s[:, None] - w[:t], 0.3 * s.mean())
    A = np.zeros((n, n))
    A[m:, :t], A[:t, m:] = Y, -Y.T
    U = (np.eye(n) + A) @ np.linalg.inv(np.eye(n) - A)
    turned: Array = np.concatenate([low, high], axis=1) @ U
    return turned


def edges_of(faces: list[list[int]]) -> Edges:
    """Section 4, kind 2, step 1."""
    return {
        (min(a, b), max(a, b))
        for face in faces
        for a, b in zip(face, face[1:] + face[:1], strict=True)
        if a != b
    }


def spring_modes(source: Bytes, N: int, faces: list[list[int]]) -> Array:
    """Section 4, kind 2: (modes, vertices)."""
    P, Q, share = source.varint(), source.varint(), source.byte()
    edges = edges_of(faces)
    entries = []
    for number, patch in enumerate(patches_of(set(range(N)), edges, P)):
        n = len(patch)
        V = joined(patch, edges, Q, share)
        for k in range(n):
            mode = np.zeros(N)
            mode[patch] = V[:, k]
            entries.append(((key(k, n), number, k), mode))
    return np.array([mode for _, mode in sorted(entries, key=lambda entry: entry[0])])
