"""Stiffness, areas and integrals over triangles, compiled."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from modalmotion.numeric.machine.compiled import kernel

_TURN: Final = 1.5 * 2.0**52


@kernel
def weigh_edges(m: int, x: Any, faces: Any, edge: Any, weight: Any, area: Any) -> None:
    """Add the cotangents over each edge, -cot / 2, and thirds of areas at vertices.

    Both come as zeros; `x` are the coordinates of one vertex after another.
    """
    for f in range(0, 3 * m, 3):
        a, b, c = 3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]
        ab0, ab1, ab2 = x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]
        ac0, ac1, ac2 = x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]
        bc0, bc1, bc2 = x[c] - x[b], x[c + 1] - x[b + 1], x[c + 2] - x[b + 2]
        n0 = ab1 * ac2 - ab2 * ac1
        n1 = ab2 * ac0 - ab0 * ac2
        n2 = ab0 * ac1 - ab1 * ac0
        twice = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        if twice > 0:
            half = -0.5 / twice
            # The angle at a weighs the side bc, and so on.
            weight[edge[f + 1]] += half * (ab0 * ac0 + ab1 * ac1 + ab2 * ac2)
            weight[edge[f + 2]] -= half * (ab0 * bc0 + ab1 * bc1 + ab2 * bc2)
            weight[edge[f]] += half * (ac0 * bc0 + ac1 * bc1 + ac2 * bc2)
            third = 0.5 * twice / 3.0
            for k in range(3):
                area[faces[f + k]] += third


@kernel
def add_weights(n: int, first: Any, end: Any, weight: Any, diagonal: Any) -> None:
    """Take off each diagonal, which comes as zero, the weights of its row."""
    for v in range(n):
        for e in range(first[v], first[v + 1]):
            diagonal[v] -= weight[e]
            diagonal[end[e]] -= weight[e]


@kernel
def keep_free(
    n: int, first: Any, end: Any, weight: Any, number: Any, n_free: int,
    free_first: Any, free_end: Any, free_weight: Any,
) -> int:  # fmt: skip
    """Keep what joins two vertices that have a new number; n_free says that they have none."""
    n_kept = 0
    for v in range(n):
        row = np.int64(number[v])
        if row == n_free:
            continue
        free_first[row] = n_kept
        for e in range(first[v], first[v + 1]):
            column = number[end[e]]
            if column != n_free:
                free_end[n_kept] = column
                free_weight[n_kept] = weight[e]
                n_kept += 1
    free_first[n_free] = n_kept
    return n_kept


@kernel
def _step(values: Any, a: int, b: int, closed: int) -> float:
    step = values[b] - values[a]
    if closed:
        # Adding this leaves the nearest whole number.
        step -= (step + _TURN) - _TURN
    return float(step)


@kernel
def add_gradients(m: int, x: Any, faces: Any, values: Any, closed: int, sums: Any) -> None:
    """Add area times length of the gradient of a linear function, and the areas.

    The formula |grad f| area = |(fb - fa) ac - (fc - fa) ab| / 2.
    """
    total, whole = 0.0, 0.0
    for f in range(0, 3 * m, 3):
        a, b, c = 3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]
        v = _step(values, faces[f], faces[f + 1], closed)
        w = _step(values, faces[f], faces[f + 2], closed)
        ab0, ab1, ab2 = x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]
        ac0, ac1, ac2 = x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]
        n0 = ab1 * ac2 - ab2 * ac1
        n1 = ab2 * ac0 - ab0 * ac2
        n2 = ab0 * ac1 - ab1 * ac0
        square = n0 * n0 + n1 * n1 + n2 * n2
        if square > 0:
            g0, g1, g2 = v * ac0 - w * ab0, v * ac1 - w * ab1, v * ac2 - w * ab2
            total += 0.5 * np.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
            whole += 0.5 * np.sqrt(square)
    sums[0] = total
    sums[1] = whole


@kernel
def add_normals(m: int, x: Any, faces: Any, sums: Any) -> None:
    """Add the cross products of two sides of each triangle."""
    total0, total1, total2 = 0.0, 0.0, 0.0
    for f in range(0, 3 * m, 3):
        a, b, c = 3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]
        ab0, ab1, ab2 = x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]
        ac0, ac1, ac2 = x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]
        total0 += ab1 * ac2 - ab2 * ac1
        total1 += ab2 * ac0 - ab0 * ac2
        total2 += ab0 * ac1 - ab1 * ac0
    sums[0] = total0
    sums[1] = total1
    sums[2] = total2


@kernel
def add_covered(
    m: int, faces: Any, s: Any, t: Any, s_closed: int, t_closed: int, sums: Any
) -> None:
    """Add the signed areas of the triangles in the plane of two coordinates."""
    total = 0.0
    for f in range(0, 3 * m, 3):
        a, b, c = faces[f], faces[f + 1], faces[f + 2]
        total += _step(s, a, b, s_closed) * _step(t, a, c, t_closed)
        total -= _step(s, a, c, s_closed) * _step(t, a, b, t_closed)
    sums[0] = 0.5 * total
