"""Sweeps of one level and steps of conjugate gradients, compiled.

Matrices as in `levels`. What is below the diagonal is not stored: its products are pushed ahead
into `pushed`, which is zero before and after.
"""

from __future__ import annotations

from typing import Any

from modalmotion.numeric.machine.compiled import kernel


@kernel
def go_down(
    n: int, first: Any, end: Any, weight: Any, inverse: Any, right: Any, x: Any, pushed: Any,
    p_start: Any, p_group: Any, p_value: Any, coarse: Any,
) -> None:  # fmt: skip
    """Sweep forward from zero and hand the residual down; `coarse` comes as zeros."""
    for i in range(n):
        value = (right[i] - pushed[i]) * inverse[i]
        pushed[i] = 0.0
        x[i] = value
        for e in range(first[i], first[i + 1]):
            pushed[end[e]] += weight[e] * value
    for i in range(n):
        # (D + L) x is the right-hand side: what is left is -U x.
        left = weight[0] - weight[0]
        for e in range(first[i], first[i + 1]):
            left -= weight[e] * x[end[e]]
        for k in range(p_start[i], p_start[i + 1]):
            coarse[p_group[k]] += p_value[k] * left


@kernel
def go_up(
    n: int, first: Any, end: Any, weight: Any, inverse: Any, right: Any, x: Any, pushed: Any,
    p_start: Any, p_group: Any, p_value: Any, coarse: Any,
) -> None:  # fmt: skip
    """Add what the coarser level found and sweep backward."""
    for i in range(n):
        value = x[i]
        for k in range(p_start[i], p_start[i + 1]):
            value += p_value[k] * coarse[p_group[k]]
        for e in range(first[i], first[i + 1]):
            pushed[end[e]] += weight[e] * value
    for back in range(n):
        i = n - 1 - back
        left = right[i] - pushed[i]
        pushed[i] = 0.0
        for e in range(first[i], first[i + 1]):
            left -= weight[e] * x[end[e]]
        x[i] = left * inverse[i]


@kernel
def multiply(
    n: int, first: Any, end: Any, weight: Any, diagonal: Any, x: Any, image: Any, sums: Any
) -> None:
    """Multiply; `image` comes as zeros. The sum is of x times its image."""
    total = 0.0
    for i in range(n):
        value = x[i]
        here = image[i] + diagonal[i] * value
        for e in range(first[i], first[i + 1]):
            j = end[e]
            here += weight[e] * x[j]
            image[j] += weight[e] * value
        image[i] = here
        total += here * value
    sums[0] = total


@kernel
def step_along(
    n: int, step: float, direction: Any, image: Any, x: Any, residual: Any, sums: Any
) -> None:
    """Step along a direction; the sum is of squares of the residual."""
    total = 0.0
    for i in range(n):
        x[i] += step * direction[i]
        left = residual[i] - step * image[i]
        residual[i] = left
        image[i] = 0.0
        total += left * left
    sums[0] = total


@kernel
def scaled_to(n: int, residual: Any, scale: float, right: Any) -> None:
    """Scale the residual to single precision."""
    for i in range(n):
        right[i] = residual[i] * scale


@kernel
def turn_to(n: int, residual: Any, z: Any, sums: Any) -> None:
    """Sum the products of the residual and the preconditioned one."""
    total = 0.0
    for i in range(n):
        total += residual[i] * z[i]
    sums[0] = total


@kernel
def redirect(n: int, share: float, z: Any, scale: float, direction: Any) -> None:
    """Make the next direction."""
    for i in range(n):
        direction[i] = share * direction[i] + scale * z[i]
