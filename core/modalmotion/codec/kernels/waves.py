"""Matrices in waves, compiled: the twin of `bits.matrix`."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from modalmotion.codec.bits.entropy import ESCAPE, N_CLASSES, N_SYMBOLS
from modalmotion.codec.bits.matrix import LARGEST_SEEN, LEFT, N_CONTEXTS, WINDOWS
from modalmotion.codec.kernels.coding import code_bits, code_symbol
from modalmotion.codec.machine.layout import PARAMETERS, READS, STATUS
from modalmotion.numeric.machine.compiled import kernel

_ROWS: Final = PARAMETERS
_COLUMNS: Final = PARAMETERS + 1
_BANDS: Final = PARAMETERS + 2
_EDGES: Final = PARAMETERS + 3
_EXTENTS: Final = PARAMETERS + 4
_NUMBERS: Final = PARAMETERS + 5
_SUMS: Final = PARAMETERS + 6
_MEANS: Final = PARAMETERS + 7
_WAVE: Final = PARAMETERS + 8
_CUTS: Final = PARAMETERS + 9
"""Sizes, then where each part of the memory begins."""

_INCREMENT: Final = 24.0
_ABOVE: Final = 3
_HALF_1: Final = WINDOWS[1][0]
_HALF_2: Final = WINDOWS[2][0]
_HALF_3: Final = WINDOWS[3][0]
_W0: Final = WINDOWS[0][1][0]
_W11, _W12, _W13 = WINDOWS[1][1]
_W21, _W22, _W23 = WINDOWS[2][1]
_W3: Final = WINDOWS[3][1][0]
_LEFT_1, _LEFT_2 = LEFT
_STRIDE_CUTS: Final = N_SYMBOLS + N_CLASSES + 4


@kernel
def _window(w: Any, row: int, low: int, high: int) -> int:
    """Sum of the magnitudes of a row from one column to before another."""
    return int(w[row + high] - w[row + low])


@kernel
def _context(w: Any, row: int, band: int, column: int) -> int:
    stride = w[_COLUMNS] + 1
    # Three rows of zeros stand above the first.
    up_1 = w[_SUMS] + (row + _ABOVE - 1) * stride
    up_2, up_3 = up_1 - stride, up_1 - 2 * stride
    end = w[w[_EDGES] + band + 1]
    means = w[_MEANS] + row * (w[_BANDS] + 2) + band
    total = _LEFT_1 * w[means + 1] + _LEFT_2 * w[means] + 2
    total += _W0 * _window(w, up_1, column, column + 1)
    low, high = max(column - _HALF_1, 0), min(column + _HALF_1 + 1, end)
    total += _W11 * _window(w, up_1, low, high)
    total += _W12 * _window(w, up_2, low, high)
    total += _W13 * _window(w, up_3, low, high)
    low, high = max(column - _HALF_2, 0), min(column + _HALF_2 + 1, end)
    total += _W21 * _window(w, up_1, low, high)
    total += _W22 * _window(w, up_2, low, high)
    total += _W23 * _window(w, up_3, low, high)
    low, high = max(column - _HALF_3, 0), min(column + _HALF_3 + 1, end)
    total += _W3 * _window(w, up_1, low, high)
    n = 0
    while total >> (n + 1):
        n += 1
    return int(min(2 * n - 2 + ((total >> (n - 1)) & 1), N_CONTEXTS - 1))


@kernel
def _cut(w: Any, tables: Any, at: int, n: int, cuts: int) -> None:
    """Boundaries of the symbols of a table, as `bits.range_coder.cuts_of`."""
    total = 0.0
    for i in range(n):
        total += tables[at + i]
    scale = (16777216.0 - n) / total
    left = 0.0
    w[cuts] = 0
    for i in range(1, n):
        left += tables[at + i - 1]
        # Truncation is rounding down: nothing here is negative.
        w[cuts + i] = np.int64(left * scale) + i
    w[cuts + n] = 16777216


@kernel
def code_waves(w: Any, words: Any, bits: Any, tables: Any) -> None:
    """Code a matrix whose extents are known.

    The tables are `N_CONTEXTS` rows of symbols, then as many of classes.
    """
    n_rows, n_bands, stride = w[_ROWS], w[_BANDS], w[_COLUMNS] + 1
    edges, extents, numbers = w[_EDGES], w[_EXTENTS], w[_NUMBERS]
    sums, means, cuts = w[_SUMS] + _ABOVE * stride, w[_MEANS], w[_CUTS]
    for t in range(n_rows + n_bands - 1):
        first_row = max(0, t - n_bands + 1)
        last_row = min(t, n_rows - 1)
        # Boundaries hold for a wave: what it counts changes the next one's.
        for context in range(N_CONTEXTS):
            w[cuts + context * _STRIDE_CUTS] = -1
            w[cuts + context * _STRIDE_CUTS + N_SYMBOLS + 1] = -1
        n = n_large = 0
        for row in range(first_row, last_row + 1):
            band = t - row
            if band >= w[extents + row]:
                continue
            for column in range(w[edges + band], w[edges + band + 1]):
                context = _context(w, row, band, column)
                at = cuts + context * _STRIDE_CUTS
                if w[at] < 0:
                    _cut(w, tables, context * N_SYMBOLS, N_SYMBOLS, at)
                place = row * (stride - 1) + column
                value = min(abs(w[numbers + place]), ESCAPE)
                symbol = code_symbol(w, words, w, at, N_SYMBOLS, value)
                if w[READS]:
                    w[numbers + place] = symbol
                wave = w[_WAVE] + 3 * n
                w[wave] = place
                w[wave + 1] = context
                w[wave + 2] = symbol
                n_large += symbol == ESCAPE
                n += 1
        if w[STATUS]:
            return
        for i in range(n):
            wave = w[_WAVE] + 3 * i
            tables[w[wave + 1] * N_SYMBOLS + w[wave + 2]] += _INCREMENT
        if n_large:
            _code_large(w, words, bits, tables, n)
        for row in range(first_row, last_row + 1):
            band = t - row
            if band >= w[extents + row]:
                continue
            _take_in(w, row, band, sums, means)
        for i in range(n):
            wave = w[_WAVE] + 3 * i
            number = numbers + w[wave]
            if w[wave + 2]:
                negative = code_bits(w, bits, 1, 1 if w[number] < 0 else 0)
                if w[READS] and negative:
                    w[number] = -w[number]
        if w[STATUS]:
            return


@kernel
def _code_large(w: Any, words: Any, bits: Any, tables: Any, n: int) -> None:
    """Code the rest of the magnitudes of a wave that are no symbol of their own."""
    classes = N_CONTEXTS * N_SYMBOLS
    for i in range(n):
        wave = w[_WAVE] + 3 * i
        if w[wave + 2] != ESCAPE:
            continue
        context = w[wave + 1]
        at = w[_CUTS] + context * _STRIDE_CUTS + N_SYMBOLS + 1
        if w[at] < 0:
            _cut(w, tables, classes + context * N_CLASSES, N_CLASSES, at)
        excess = abs(w[w[_NUMBERS] + w[wave]]) - ESCAPE + 1
        size = 0
        while excess >> (size + 1) > 0:
            size += 1
        w[wave + 2] = ESCAPE + code_symbol(w, words, w, at, N_CLASSES, size)
    for i in range(n):
        wave = w[_WAVE] + 3 * i
        if w[wave + 2] >= ESCAPE:
            size = w[wave + 2] - ESCAPE
            tables[classes + w[wave + 1] * N_CLASSES + size] += _INCREMENT
    for i in range(n):
        wave = w[_WAVE] + 3 * i
        if w[wave + 2] >= ESCAPE:
            size = w[wave + 2] - ESCAPE
            excess = abs(w[w[_NUMBERS] + w[wave]]) - ESCAPE + 1
            low = code_bits(w, bits, size, excess - (1 << size))
            if w[READS]:
                w[w[_NUMBERS] + w[wave]] = ESCAPE - 1 + (1 << size) + low


@kernel
def _take_in(w: Any, row: int, band: int, sums: int, means: int) -> None:
    """Add up the magnitudes of a tile for those that look at it."""
    columns = w[_COLUMNS]
    low, high = w[w[_EDGES] + band], w[w[_EDGES] + band + 1]
    running = sums + row * (columns + 1)
    before = w[running + low]
    for column in range(low, high):
        magnitude = min(abs(w[w[_NUMBERS] + row * columns + column]), LARGEST_SEEN)
        w[running + column + 1] = w[running + column] + magnitude
    seen = w[running + high] - before
    w[means + row * (w[_BANDS] + 2) + band + 2] = 64 * seen // (high - low)
