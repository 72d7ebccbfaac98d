"""Entries of the kernels of a surface: addresses become arrays, as long as their caller says."""

from __future__ import annotations

from typing import Any, Final

from numba import carray

from modalmotion.mesh.kernels.measures import (
    add_covered,
    add_gradients,
    add_normals,
    add_weights,
    keep_free,
    weigh_edges,
)
from modalmotion.mesh.kernels.sides import join_sides, name_pieces, sort_codes

# Nothing compares an index with it.
_ANY: Final = 1 << 40


def _join_sides(
    n: int, m: int, faces: Any, first: Any, keys: Any, end: Any, count: Any, ahead: Any, edge: Any
) -> int:
    return join_sides(
        n,
        m,
        carray(faces, _ANY),
        carray(first, _ANY),
        carray(keys, _ANY),
        carray(end, _ANY),
        carray(count, _ANY),
        carray(ahead, _ANY),
        carray(edge, _ANY),
    )


def _name_pieces(n: int, first: Any, end: Any, name: Any) -> int:
    return name_pieces(n, carray(first, _ANY), carray(end, _ANY), carray(name, _ANY))


def _sort_codes(n: int, codes: Any, order: Any, other_codes: Any, other: Any, counts: Any) -> int:
    sort_codes(
        n,
        carray(codes, _ANY),
        carray(order, _ANY),
        carray(other_codes, _ANY),
        carray(other, _ANY),
        carray(counts, _ANY),
    )
    return 0


def _weigh_edges(m: int, x: Any, faces: Any, edge: Any, weight: Any, area: Any) -> int:
    weigh_edges(
        m,
        carray(x, _ANY),
        carray(faces, _ANY),
        carray(edge, _ANY),
        carray(weight, _ANY),
        carray(area, _ANY),
    )
    return 0


def _add_weights(n: int, first: Any, end: Any, weight: Any, diagonal: Any) -> int:
    add_weights(
        n, carray(first, _ANY), carray(end, _ANY), carray(weight, _ANY), carray(diagonal, _ANY)
    )
    return 0


def _keep_free(
    n: int,
    first: Any,
    end: Any,
    weight: Any,
    number: Any,
    n_free: int,
    free_first: Any,
    free_end: Any,
    free_weight: Any,
) -> int:
    return keep_free(
        n,
        carray(first, _ANY),
        carray(end, _ANY),
        carray(weight, _ANY),
        carray(number, _ANY),
        n_free,
        carray(free_first, _ANY),
        carray(free_end, _ANY),
        carray(free_weight, _ANY),
    )


def _add_gradients(m: int, x: Any, faces: Any, values: Any, closed: int, sums: Any) -> int:
    add_gradients(
        m, carray(x, _ANY), carray(faces, _ANY), carray(values, _ANY), closed, carray(sums, _ANY)
    )
    return 0


def _add_normals(m: int, x: Any, faces: Any, sums: Any) -> int:
    add_normals(m, carray(x, _ANY), carray(faces, _ANY), carray(sums, _ANY))
    return 0


def _add_covered(
    m: int, faces: Any, s: Any, t: Any, s_closed: int, t_closed: int, sums: Any
) -> int:
    add_covered(
        m,
        carray(faces, _ANY),
        carray(s, _ANY),
        carray(t, _ANY),
        s_closed,
        t_closed,
        carray(sums, _ANY),
    )
    return 0


ENTRIES: Final = {
    _join_sides: "iiUULUBBU",
    _name_pieces: "iUUU",
    _sort_codes: "iLULUL",
    _weigh_edges: "iDUUDD",
    _add_weights: "iUUDD",
    _keep_free: "iUUDUiUUD",
    _add_gradients: "iDUDiD",
    _add_normals: "iDUD",
    _add_covered: "iUDDiiD",
}
