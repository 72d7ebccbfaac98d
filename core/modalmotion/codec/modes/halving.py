"""Patches of a mesh: its parts, halved until each is small enough."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.bits.entropy import Writer
from modalmotion.codec.machine.image import Image, image
from modalmotion.codec.machine.layout import PARAMETERS
from modalmotion.codec.machine.memory import call
from modalmotion.native import library, run

Ints = NDArray[np.int64]


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
    compiled = image()
    owner = np.empty(n_vertices, dtype=np.int64)
    if library() is not None:
        room = np.empty(5 * n_vertices + 2, dtype=np.int64)
        run("mm_halve", n_vertices, offsets, neighbours, largest, owner, room)
    elif compiled is None:
        owner = _halve(offsets.tolist(), neighbours.tolist(), largest)
    else:
        owner = _halve_compiled(compiled, offsets, neighbours, largest)
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


def _halve_compiled(compiled: Image, offsets: Ints, neighbours: Ints, largest: int) -> Ints:
    n = len(offsets) - 1
    parts: dict[int, Ints | int] = {PARAMETERS + 2: offsets, PARAMETERS + 3: neighbours}
    parts |= dict.fromkeys(range(PARAMETERS + 4, PARAMETERS + 8), n)
    parts |= dict.fromkeys((PARAMETERS + 8, PARAMETERS + 9), n + 1)
    w = call(compiled, "halve", Writer(), (n, largest), parts)
    at = w[PARAMETERS + 4]
    owner: Ints = w[at : at + n]
    return owner


def _halve(offsets: list[int], neighbours: list[int], largest: int) -> Ints:
    owner = np.zeros(len(offsets) - 1, dtype=np.int64)
    label = owner.tolist()
    n_labels = 1
    todo = [(0, list(range(len(label))))]
    while todo:
        part, vertices = todo.pop()
        for number, first in enumerate(vertices):
            if label[first] != part:
                continue
            order = _breadth_first(offsets, neighbours, label, first, n_labels)
            if len(order) > largest:
                order = _breadth_first(offsets, neighbours, label, order[-1], n_labels + 1)
                for place, v in enumerate(order):
                    label[v] = n_labels + (1 if place < len(order) // 2 else 2)
                halves = (n_labels + 1, n_labels + 2)
                left = vertices[number:]
                todo += [(half, [v for v in left if label[v] == half]) for half in halves]
            n_labels += 3
    owner[:] = label
    return owner


def _breadth_first(
    offsets: list[int], neighbours: list[int], label: list[int], first: int, new: int
) -> list[int]:
    """List what is connected and has the same label, and give it a new one."""
    old = label[first]
    label[first] = new
    order = [first]
    for v in order:
        for u in neighbours[offsets[v] : offsets[v + 1]]:
            if label[u] == old:
                label[u] = new
                order.append(u)
    return order
