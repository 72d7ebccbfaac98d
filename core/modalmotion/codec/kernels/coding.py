"""Range coder and plain bits, compiled: the twin of `bits.range_coder`."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from modalmotion.codec.machine.layout import (
    BIT,
    DAMAGED,
    FEW_BITS,
    FINE,
    FIRST,
    FULL,
    INVERTED,
    LOWER,
    N_BITS,
    N_WORDS,
    POINT,
    RANGE,
    READS,
    STATUS,
    WORD,
)
from modalmotion.numeric.machine.compiled import kernel

_PRECISION: Final = np.uint64(24)
_WORD: Final = np.uint64(32)
_SMALLEST: Final = np.uint64(1 << 32)
_LOW: Final = np.uint64(0xFFFFFFFF)
_ONES: Final = 0xFFFFFFFF
_ODDS_SCALE: Final = (2.0**24 - 2.0) / 65536.0


@kernel
def fail(w: Any, status: int) -> None:
    """Note the first thing that went wrong."""
    if w[STATUS] == FINE:
        w[STATUS] = status


@kernel
def write_word(w: Any, words: Any, word: int) -> None:
    """Put down a word."""
    if w[WORD] < w[N_WORDS]:
        words[w[WORD]] = np.uint32(word)
        w[WORD] += 1
    else:
        fail(w, FULL)


@kernel
def narrow(w: Any, words: Any, left: int, right: int) -> None:
    """Take the part from left to right of 2^24 as the new interval."""
    lower, extent = np.uint64(w[LOWER]), np.uint64(w[RANGE])
    scale = extent >> _PRECISION
    new = lower + scale * np.uint64(left)
    extent = scale * np.uint64(right - left)
    if w[READS]:
        if extent < _SMALLEST:
            new <<= _WORD
            extent <<= _WORD
            point = np.uint64(w[POINT]) << _WORD
            if w[WORD] < w[N_WORDS]:
                point |= np.uint64(words[w[WORD]])
                w[WORD] += 1
            w[POINT] = np.int64(point)
    else:
        if w[INVERTED] and new + extent > new:
            # The words that waited for a carry are decided.
            carried = new < lower
            write_word(w, words, w[FIRST] + 1 if carried else w[FIRST])
            for _ in range(1, w[INVERTED]):
                write_word(w, words, 0 if carried else _ONES)
            w[INVERTED] = 0
        if extent < _SMALLEST:
            word = int(np.int64(new >> _WORD))
            new <<= _WORD
            extent <<= _WORD
            if w[INVERTED]:
                w[INVERTED] += 1
            elif new + extent > new:
                write_word(w, words, word)
            else:
                w[INVERTED] = 1
                w[FIRST] = word
    w[LOWER] = np.int64(new)
    w[RANGE] = np.int64(extent)


@kernel
def reaches(w: Any, left: int) -> bool:
    """Whether the point to be read lies at or beyond a boundary, in 2^-24 of the interval."""
    scale = np.uint64(w[RANGE]) >> _PRECISION
    return bool(np.uint64(w[POINT]) - np.uint64(w[LOWER]) >= scale * np.uint64(left))


@kernel
def code_odds(w: Any, words: Any, chance: int, value: int) -> int:
    """Code yes (1) or no (0), yes with a chance in 1/65536."""
    # Truncation is rounding down: nothing here is negative.
    split = int(np.float64(65536 - chance) * _ODDS_SCALE) + 1
    if w[READS]:
        if reaches(w, 1 << 24):
            fail(w, DAMAGED)
            return 0
        value = 1 if reaches(w, split) else 0
    if value:
        narrow(w, words, split, 1 << 24)
    else:
        narrow(w, words, 0, split)
    return value


@kernel
def code_symbol(w: Any, words: Any, cuts: Any, at: int, n: int, value: int) -> int:
    """Code one of n symbols; the symbol i begins at cuts[at + i]."""
    if w[READS]:
        if reaches(w, 1 << 24):
            fail(w, DAMAGED)
            return 0
        value = 0
        while value < n - 1 and reaches(w, cuts[at + value + 1]):
            value += 1
    narrow(w, words, cuts[at + value], cuts[at + value + 1])
    return value


@kernel
def code_bits(w: Any, bits: Any, width: int, value: int) -> int:
    """Code a plain number of so many bits."""
    if w[BIT] + width > w[N_BITS]:
        fail(w, FEW_BITS if w[READS] else FULL)
        return 0
    if w[READS]:
        value = 0
        for _ in range(width):
            value = 2 * value + int(bits[w[BIT]])
            w[BIT] += 1
    else:
        for i in range(width):
            bits[w[BIT]] = (value >> (width - 1 - i)) & 1
            w[BIT] += 1
    return value
