"""Mixed matrices, compiled: the twin of `bits.mixed_matrix`."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.codec.bits.matrix import LARGEST_SEEN
from modalmotion.codec.bits.mixed_matrix import N_STEPS, ROWS_ABOVE, WIDEST
from modalmotion.codec.kernels.answers import ask, code_number, set_context
from modalmotion.codec.kernels.coding import code_bits
from modalmotion.codec.machine.layout import PARAMETERS, READS, STATUS
from modalmotion.numeric.machine.compiled import kernel

_ROWS: Final = PARAMETERS
_COLUMNS: Final = PARAMETERS + 1
_ENDS: Final = PARAMETERS + 2
_NUMBERS: Final = PARAMETERS + 3
_SEEN: Final = PARAMETERS + 4
_SUMS: Final = PARAMETERS + 5

_N_CONTEXTS: Final = 8
_LARGER: Final = N_STEPS


@kernel
def _size(value: int) -> int:
    """Two classes for each doubling."""
    value += 2
    n = 1
    while value >> (n + 1):
        n += 1
    return 2 * n - 2 + ((value >> (n - 1)) & 1)


@kernel
def _set_contexts(w: Any, row: int, column: int) -> int:
    """Set the eight contexts of an entry; give the first."""
    # Rows of zeros stand above the first, and zeros on both sides of each.
    stride = w[_COLUMNS] + 2 * WIDEST + 2
    seen = w[_SEEN] + (row + ROWS_ABOVE) * stride + WIDEST + column
    sums = w[_SUMS] + (row + ROWS_ABOVE) * stride + WIDEST + column
    first, second, third = sums - stride, sums - 2 * stride, sums - 3 * stride
    near_1 = w[first + 2] - w[first - 1]
    near_2 = w[second + 2] - w[second - 1]
    near_3 = w[third + 2] - w[third - 1]
    wide_1 = w[first + 7] - w[first - 6]
    wide_2 = w[second + 7] - w[second - 6]
    wide_3 = w[third + 7] - w[third - 6]
    left = w[sums] - w[sums - 8]
    far_left = w[sums] - w[sums - WIDEST]
    up = w[seen - stride]
    expected = 60 * up + 24 * near_1 + 12 * near_2 + 14 * near_3
    expected += 8 * wide_1 + 5 * wide_2 + 5 * wide_3 + 32 * left
    size, size_up, size_left = _size(expected), _size(up), _size(left)
    set_context(w, 0, 0, size)
    set_context(w, 1, 0, _size(4 * left) << 8 | _size(2 * wide_1))
    set_context(
        w, 2, 0, size_up << 16 | _size(w[seen - 2 * stride]) << 8 | _size(w[seen - 3 * stride])
    )
    set_context(w, 3, 0, _size(near_1) << 8 | _size(near_3))
    set_context(w, 4, 0, _size(far_left) << 8 | size_left)
    set_context(w, 5, 0, min(column, 60) << 8 | row % 3)
    set_context(w, 6, 0, _size(w[seen - 1]) << 16 | _size(w[seen - 2]) << 8 | size_up)
    set_context(w, 7, 0, _size(wide_1 + wide_2 + wide_3) << 8 | _size(w[seen - 6 * stride]))
    return size


@kernel
def _code_magnitude(w: Any, words: Any, bits: Any, size: int, value: int) -> int:
    for step in range(N_STEPS):
        if not ask(w, words, step, 0, _N_CONTEXTS, 1 if value > step else 0):
            return step
    set_context(w, 0, 0, 0)
    set_context(w, 1, 0, size)
    return N_STEPS + code_number(w, words, bits, _LARGER, 2, max(value - N_STEPS, 0))


@kernel
def code_mixed(w: Any, words: Any, bits: Any) -> None:
    """Code a matrix whose extents are known."""
    columns = w[_COLUMNS]
    stride = columns + 2 * WIDEST + 2
    for row in range(w[_ROWS]):
        seen = w[_SEEN] + (row + ROWS_ABOVE) * stride + WIDEST
        sums = w[_SUMS] + (row + ROWS_ABOVE) * stride + WIDEST
        end = w[w[_ENDS] + row]
        for column in range(end):
            size = _set_contexts(w, row, column)
            number = w[_NUMBERS] + row * columns + column
            magnitude = _code_magnitude(w, words, bits, size, abs(w[number]))
            if w[READS]:
                w[number] = magnitude
            w[seen + column] = min(magnitude, LARGEST_SEEN)
            w[sums + column + 1] = w[sums + column] + w[seen + column]
        for column in range(end, columns + WIDEST + 1):
            w[sums + column + 1] = w[sums + column]
        if w[STATUS]:
            return
    for number in range(w[_NUMBERS], w[_NUMBERS] + w[_ROWS] * columns):
        if w[number]:
            negative = code_bits(w, bits, 1, 1 if w[number] < 0 else 0)
            if w[READS] and negative:
                w[number] = -w[number]
