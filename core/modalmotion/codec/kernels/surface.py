"""Faces of a mesh, compiled: the twin of `connectivity.pure_faces`."""

from __future__ import annotations

from typing import Any

from modalmotion.codec.connectivity.numbering import FAR, N_PROPOSED
from modalmotion.codec.connectivity.rings import NOWHERE
from modalmotion.codec.connectivity.walk import GIVEN_UP
from modalmotion.codec.kernels.answers import place_of
from modalmotion.codec.kernels.ring_walks import degree, make_rings
from modalmotion.codec.kernels.steps import LAST_DISTANCES, NODE, ORIGIN, OUTCOME
from modalmotion.codec.kernels.triangles import code_corner, earlier_ahead, end_of, first_pivot
from modalmotion.codec.kernels.vertex_order import code_vertex
from modalmotion.codec.machine.layout import READS, STATUS
from modalmotion.codec.machine.places import (
    DISTANCE,
    FACES,
    FREE_AT,
    KEEPS_ORDER,
    LAST_AHEAD,
    LATEST,
    MET,
    N_DONE,
    N_MET,
    NEXT_BESIDE,
    NODE_OF,
    NODES,
    NUMBER,
    SMALL,
    TAG_BESIDE,
    TRIANGLES,
    USED,
    VERTICES,
    WALK_ONLY,
)
from modalmotion.numeric.machine.compiled import kernel


@kernel
def code_surface(w: Any, words: Any, bits: Any) -> None:
    """Code the triangles, then which node each vertex is."""
    w[LATEST] = -1
    if w[READS]:
        _read_triangles(w, words, bits)
    elif w[KEEPS_ORDER]:
        for face in range(w[FACES]):
            _write_triangle(w, words, bits, face, 0)
    else:
        _write_fans(w, words, bits)
    if w[STATUS] or w[WALK_ONLY]:
        return
    make_rings(w)
    if w[STATUS]:
        return
    n, small = w[VERTICES], w[SMALL]
    for v in range(n):
        w[w[NUMBER] + v] = -1
        w[w[DISTANCE] + v] = FAR
        w[w[FREE_AT] + v] = FAR if degree(w, v) else -1
    w[small + NODE] = NOWHERE
    w[small + ORIGIN] = NOWHERE
    w[small + OUTCOME] = N_PROPOSED
    for i in range(4):
        w[small + LAST_DISTANCES + i] = FAR
    for vertex in range(n):
        node = 0
        if not w[READS]:
            node = w[w[NODE_OF] + vertex]
            if node < 0:
                node = w[N_MET]
        code_vertex(w, words, bits, node)
        if w[STATUS]:
            return


@kernel
def _read_triangles(w: Any, words: Any, bits: Any) -> None:
    n = 0
    while n < 3 * w[FACES]:
        node = code_corner(w, words, bits, 0)
        if w[STATUS]:
            return
        if node != GIVEN_UP:
            w[w[MET] + n] = node
            n += 1


@kernel
def _write_triangle(w: Any, words: Any, bits: Any, face: int, first: int) -> None:
    """Write a triangle of vertices, beginning with one of its corners."""
    met = w[MET] + 3 * w[N_DONE]
    for i in range(3):
        vertex = w[w[TRIANGLES] + 3 * face + (first + i) % 3]
        node = w[w[NODE_OF] + vertex]
        if node < 0:
            node = w[N_MET]
            w[w[NODE_OF] + vertex] = node
            # Until the order of the vertices is coded: the vertex of each node.
            w[w[NODES] + node] = vertex
        w[met + i] = code_corner(w, words, bits, node)


@kernel
def _write_fans(w: Any, words: Any, bits: Any) -> None:
    """Go round one pivot after the other."""
    for corner in range(3 * w[FACES] - 1, -1, -1):
        face = corner // 3
        a = w[w[TRIANGLES] + corner]
        b = w[w[TRIANGLES] + 3 * face + (corner + 1) % 3]
        at = place_of(w, TAG_BESIDE | a << 5, b)
        w[w[NEXT_BESIDE] + corner] = w[at]
        w[at] = corner + 1
    first_unused = n_written = 0
    while n_written < w[FACES] and not w[STATUS]:
        pivot = first_pivot(w)
        if pivot < 0:
            while w[w[USED] + first_unused]:
                first_unused += 1
            face = first_unused
            vertex = w[w[TRIANGLES] + 3 * face]
        else:
            vertex = w[w[NODES] + pivot]
            face = _waiting(w, pivot, vertex)
        if face < 0:
            code_corner(w, words, bits, GIVEN_UP)
            continue
        w[w[USED] + face] = 1
        n_written += 1
        first = 0
        while w[w[TRIANGLES] + 3 * face + first] != vertex:
            first += 1
        _write_triangle(w, words, bits, face, first)


@kernel
def _waiting(w: Any, pivot: int, vertex: int) -> int:
    """Find a triangle on an open edge that leaves the pivot, or -1."""
    edge = w[w[LAST_AHEAD] + pivot]
    while edge:
        at = place_of(w, TAG_BESIDE | vertex << 5, w[w[NODES] + end_of(w, edge)])
        # Triangles that are written never wait again.
        while w[at] and w[w[USED] + (w[at] - 1) // 3]:
            w[at] = w[w[NEXT_BESIDE] + w[at] - 1]
        if w[at]:
            return int((w[at] - 1) // 3)
        edge = earlier_ahead(w, edge)
    return -1
