"""Levels of smoothed aggregation, compiled: rows, groups, interpolation, coarser matrices.

A symmetric matrix is its diagonal and, row by row, the entries right of it: `first`, (n + 1,),
`end` and `weight`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from modalmotion.numeric.machine.compiled import kernel


@kernel
def whole_rows(
    n: int, first: Any, end: Any, weight: Any, start: Any, column: Any, value: Any
) -> None:
    """Give whole rows off the diagonal; `start`, (n + 2,), comes as zeros."""
    for i in range(n):
        start[i + 2] += first[i + 1] - first[i]
        for e in range(first[i], first[i + 1]):
            start[end[e] + 2] += 1
    for i in range(n):
        start[i + 2] += start[i + 1]
    for i in range(n):
        for e in range(first[i], first[i + 1]):
            j = end[e]
            at = start[i + 1]
            start[i + 1] = at + 1
            column[at] = j
            value[at] = weight[e]
            at = start[j + 1]
            start[j + 1] = at + 1
            column[at] = i
            value[at] = weight[e]


@kernel
def group_unknowns(
    n: int, start: Any, column: Any, value: Any, diagonal: Any, strong: float, group: Any
) -> int:
    """Put each unknown in a group of strongly joined ones; `group` comes as n; give their number.

    First each unknown whose strong neighbours are all free, with these; then what is left to
    the group of a strong neighbour; then what is left with its free strong neighbours.
    """
    least = strong * strong
    n_groups = 0
    for i in range(n):
        if group[i] != n:
            continue
        is_free, n_strong = True, 0
        for e in range(start[i], start[i + 1]):
            j = column[e]
            if value[e] * value[e] >= least * diagonal[i] * diagonal[j]:
                n_strong += 1
                if group[j] != n:
                    is_free = False
                    break
        if not is_free or not n_strong:
            continue
        group[i] = n_groups
        for e in range(start[i], start[i + 1]):
            j = column[e]
            if value[e] * value[e] >= least * diagonal[i] * diagonal[j]:
                group[j] = n_groups
        n_groups += 1
    n_first = n_groups
    for i in range(n):
        if group[i] != n:
            continue
        largest = 0.0
        found: Any = n
        for e in range(start[i], start[i + 1]):
            j = column[e]
            size = value[e] * value[e] / diagonal[j]
            # Those that were added in this pass have names beyond n.
            if group[j] < n_first and size >= least * diagonal[i] and size > largest:
                largest, found = size, np.int64(group[j])
        if found != n:
            group[i] = n + 1 + found
    for i in range(n):
        if group[i] > n:
            group[i] -= n + 1
    for i in range(n):
        if group[i] != n:
            continue
        group[i] = n_groups
        for e in range(start[i], start[i + 1]):
            j = column[e]
            if group[j] == n and value[e] * value[e] >= least * diagonal[i] * diagonal[j]:
                group[j] = n_groups
        n_groups += 1
    return n_groups


@kernel
def smooth_groups(
    n: int, start: Any, column: Any, value: Any, diagonal: Any, group: Any, omega: float,
    p_start: Any, p_group: Any, p_value: Any,
) -> int:  # fmt: skip
    """Give interpolation: one Jacobi step from a constant on each group; number of entries."""
    at = 0
    for i in range(n):
        p_start[i] = at
        share = omega / diagonal[i]
        own = at
        p_group[at] = group[i]
        p_value[at] = 1.0 - omega
        at += 1
        for e in range(start[i], start[i + 1]):
            g = group[column[e]]
            k = own
            while k < at and p_group[k] != g:
                k += 1
            if k == at:
                p_group[at] = g
                p_value[at] = 0.0
                at += 1
            p_value[k] -= share * value[e]
    p_start[n] = at
    return at


@kernel
def turn_over(
    n: int, n_groups: int, p_start: Any, p_group: Any, p_value: Any,
    t_start: Any, t_row: Any, t_value: Any,
) -> None:  # fmt: skip
    """Transpose; `t_start`, (groups + 2,), comes as zeros."""
    for k in range(p_start[n]):
        t_start[p_group[k] + 2] += 1
    for g in range(n_groups):
        t_start[g + 2] += t_start[g + 1]
    for i in range(n):
        for k in range(p_start[i], p_start[i + 1]):
            at = t_start[p_group[k] + 1]
            t_start[p_group[k] + 1] = at + 1
            t_row[at] = i
            t_value[at] = p_value[k]


@kernel
def image_rows(
    n: int,
    start: Any,
    column: Any,
    value: Any,
    diagonal: Any,
    p_start: Any,
    p_group: Any,
    p_value: Any,
    place: Any,
    a_start: Any,
    a_group: Any,
    a_value: Any,
    room: int,
) -> int:
    """Give A P; `place`, (groups,), comes as zeros; -1 where there is too little room."""
    at = 0
    for i in range(n):
        row = at
        a_start[i] = row
        for e in range(np.int64(start[i]) - 1, np.int64(start[i + 1])):
            # First the diagonal, then the others.
            is_own = e < start[i]
            j = i if is_own else column[e]
            entry = diagonal[i] if is_own else value[e]
            for k in range(p_start[j], p_start[j + 1]):
                h = p_group[k]
                # One more than the place, so that 0 is none.
                known: Any = np.int64(place[h])
                if known <= row:
                    if at == room:
                        return -1
                    a_group[at] = h
                    a_value[at] = 0.0
                    at += 1
                    place[h] = at
                    known = at
                a_value[known - 1] += entry * p_value[k]
    a_start[n] = at
    return at


@kernel
def coarser(
    n_groups: int,
    t_start: Any,
    t_row: Any,
    t_value: Any,
    a_start: Any,
    a_group: Any,
    a_value: Any,
    place: Any,
    first: Any,
    end: Any,
    weight: Any,
    diagonal: Any,
    room: int,
) -> int:
    """Give P^T (A P); `place`, (groups,), comes as zeros; -1 where there is too little room."""
    at = 0
    for g in range(n_groups):
        row = at
        first[g] = row
        total = 0.0
        for r in range(t_start[g], t_start[g + 1]):
            i, share = t_row[r], t_value[r]
            for k in range(a_start[i], a_start[i + 1]):
                h = a_group[k]
                if h > g:
                    known: Any = np.int64(place[h])
                    if known <= row:
                        if at == room:
                            return -1
                        end[at] = h
                        weight[at] = 0.0
                        at += 1
                        place[h] = at
                        known = at
                    weight[known - 1] += share * a_value[k]
                elif h == g:
                    total += share * a_value[k]
        diagonal[g] = total
    first[n_groups] = at
    return at
