"""Entries of the kernels of a solution: addresses become arrays, as long as their caller says."""

from __future__ import annotations

from typing import Any, Final

from numba import carray

from modalmotion.mesh.kernels.cycle import (
    go_down,
    go_up,
    multiply,
    redirect,
    scaled_to,
    step_along,
    turn_to,
)
from modalmotion.mesh.kernels.levels import (
    coarser,
    group_unknowns,
    image_rows,
    smooth_groups,
    turn_over,
    whole_rows,
)

# Nothing compares an index with it.
_ANY: Final = 1 << 40


def _whole_rows(
    n: int, first: Any, end: Any, weight: Any, start: Any, column: Any, value: Any
) -> int:
    whole_rows(
        n,
        carray(first, _ANY),
        carray(end, _ANY),
        carray(weight, _ANY),
        carray(start, _ANY),
        carray(column, _ANY),
        carray(value, _ANY),
    )
    return 0


def _group_unknowns(
    n: int, start: Any, column: Any, value: Any, diagonal: Any, strong: float, group: Any
) -> int:
    return group_unknowns(
        n,
        carray(start, _ANY),
        carray(column, _ANY),
        carray(value, _ANY),
        carray(diagonal, _ANY),
        strong,
        carray(group, _ANY),
    )


def _smooth_groups(
    n: int,
    start: Any,
    column: Any,
    value: Any,
    diagonal: Any,
    group: Any,
    omega: float,
    p_start: Any,
    p_group: Any,
    p_value: Any,
) -> int:
    return smooth_groups(
        n,
        carray(start, _ANY),
        carray(column, _ANY),
        carray(value, _ANY),
        carray(diagonal, _ANY),
        carray(group, _ANY),
        omega,
        carray(p_start, _ANY),
        carray(p_group, _ANY),
        carray(p_value, _ANY),
    )


def _turn_over(
    n: int,
    n_groups: int,
    p_start: Any,
    p_group: Any,
    p_value: Any,
    t_start: Any,
    t_row: Any,
    t_value: Any,
) -> int:
    turn_over(
        n,
        n_groups,
        carray(p_start, _ANY),
        carray(p_group, _ANY),
        carray(p_value, _ANY),
        carray(t_start, _ANY),
        carray(t_row, _ANY),
        carray(t_value, _ANY),
    )
    return 0


def _image_rows(
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
    return image_rows(
        n,
        carray(start, _ANY),
        carray(column, _ANY),
        carray(value, _ANY),
        carray(diagonal, _ANY),
        carray(p_start, _ANY),
        carray(p_group, _ANY),
        carray(p_value, _ANY),
        carray(place, _ANY),
        carray(a_start, _ANY),
        carray(a_group, _ANY),
        carray(a_value, _ANY),
        room,
    )


def _coarser(
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
    return coarser(
        n_groups,
        carray(t_start, _ANY),
        carray(t_row, _ANY),
        carray(t_value, _ANY),
        carray(a_start, _ANY),
        carray(a_group, _ANY),
        carray(a_value, _ANY),
        carray(place, _ANY),
        carray(first, _ANY),
        carray(end, _ANY),
        carray(weight, _ANY),
        carray(diagonal, _ANY),
        room,
    )


def _go_down(
    n: int,
    first: Any,
    end: Any,
    weight: Any,
    inverse: Any,
    right: Any,
    x: Any,
    pushed: Any,
    p_start: Any,
    p_group: Any,
    p_value: Any,
    coarse: Any,
) -> int:
    go_down(
        n,
        carray(first, _ANY),
        carray(end, _ANY),
        carray(weight, _ANY),
        carray(inverse, _ANY),
        carray(right, _ANY),
        carray(x, _ANY),
        carray(pushed, _ANY),
        carray(p_start, _ANY),
        carray(p_group, _ANY),
        carray(p_value, _ANY),
        carray(coarse, _ANY),
    )
    return 0


def _go_up(
    n: int,
    first: Any,
    end: Any,
    weight: Any,
    inverse: Any,
    right: Any,
    x: Any,
    pushed: Any,
    p_start: Any,
    p_group: Any,
    p_value: Any,
    coarse: Any,
) -> int:
    go_up(
        n,
        carray(first, _ANY),
        carray(end, _ANY),
        carray(weight, _ANY),
        carray(inverse, _ANY),
        carray(right, _ANY),
        carray(x, _ANY),
        carray(pushed, _ANY),
        carray(p_start, _ANY),
        carray(p_group, _ANY),
        carray(p_value, _ANY),
        carray(coarse, _ANY),
    )
    return 0


def _multiply(
    n: int, first: Any, end: Any, weight: Any, diagonal: Any, x: Any, image: Any, sums: Any
) -> int:
    multiply(
        n,
        carray(first, _ANY),
        carray(end, _ANY),
        carray(weight, _ANY),
        carray(diagonal, _ANY),
        carray(x, _ANY),
        carray(image, _ANY),
        carray(sums, _ANY),
    )
    return 0


def _step_along(
    n: int, step: float, direction: Any, image: Any, x: Any, residual: Any, sums: Any
) -> int:
    step_along(
        n,
        step,
        carray(direction, _ANY),
        carray(image, _ANY),
        carray(x, _ANY),
        carray(residual, _ANY),
        carray(sums, _ANY),
    )
    return 0


def _scaled_to(n: int, residual: Any, scale: float, right: Any) -> int:
    scaled_to(n, carray(residual, _ANY), scale, carray(right, _ANY))
    return 0


def _turn_to(n: int, residual: Any, z: Any, sums: Any) -> int:
    turn_to(n, carray(residual, _ANY), carray(z, _ANY), carray(sums, _ANY))
    return 0


def _redirect(n: int, share: float, z: Any, scale: float, direction: Any) -> int:
    redirect(n, share, carray(z, _ANY), scale, carray(direction, _ANY))
    return 0


ENTRIES: Final = {
    _whole_rows: "iUUDUUD",
    _group_unknowns: "iUUDDdU",
    _smooth_groups: "iUUDDUdUUD",
    _turn_over: "iiUUDUUD",
    _image_rows: "iUUDDUUDUUUDi",
    _coarser: "iUUDUUDUUUDDi",
    _go_down: "iUUFFFFFUUFF",
    _go_up: "iUUFFFFFUUFF",
    _multiply: "iUUDDDDD",
    _step_along: "idDDDDD",
    _scaled_to: "iDdF",
    _turn_to: "iDFD",
    _redirect: "idFdD",
}
