"""Hash table and answers, compiled: the twin of `bits.mixing`."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from modalmotion.codec.bits.mixing import (
    CHANCES,
    LARGEST_LOGIT,
    LOGARITHMS,
    MOST_COUNTED,
    WIDEST_NUMBER,
)
from modalmotion.codec.kernels.coding import code_bits, code_odds, fail
from modalmotion.codec.machine.layout import (
    CAPACITY,
    CONTEXTS,
    ENDLESS,
    FULL,
    MOST_CONTEXTS,
    N_KEYS,
    STATUS,
    TABLE,
    WEIGHTS,
)
from modalmotion.numeric.machine.compiled import kernel

_LOGARITHMS: Final = np.array(LOGARITHMS, dtype=np.int64)
_CHANCES: Final = np.array(CHANCES, dtype=np.int64)
_MIX_1: Final = np.uint64(0x9E3779B97F4A7C15)
_MIX_2: Final = np.uint64(0xC2B2AE3D27D4EB4F)
_SHIFT: Final = np.uint64(29)
_COUNTS: Final = 1


@kernel
def place_of(w: Any, tag: int, key: int) -> int:
    """Place of the value of a key in the memory; 0 there if the key is new.

    Keys are compared whole: two that hash alike are two. A tag is never 0.
    """
    n = w[CAPACITY]
    h = (np.uint64(tag) * _MIX_1) ^ (np.uint64(key) * _MIX_2)
    h ^= h >> _SHIFT
    h *= _MIX_1
    h ^= h >> _SHIFT
    i = np.int64(h & np.uint64(n - 1))
    first = w[TABLE]
    while True:
        at = first + 3 * i
        if w[at] == 0:
            break
        if w[at] == tag and w[at + 1] == key:
            return int(at + 2)
        i = (i + 1) & (n - 1)
    if 3 * w[N_KEYS] >= 2 * n:
        fail(w, FULL)
        # Whatever is kept here is thrown away.
        w[first + 3 * n + 2] = 0
        return int(first + 3 * n + 2)
    w[N_KEYS] += 1
    w[at] = tag
    w[at + 1] = key
    return int(at + 2)


@kernel
def set_context(w: Any, number: int, high: int, low: int) -> None:
    """State a context of the next question: 39 and 64 bits that nothing else has."""
    w[w[CONTEXTS] + 2 * number] = high
    w[w[CONTEXTS] + 2 * number + 1] = low


@kernel
def ask(w: Any, words: Any, question: int, step: int, n: int, value: int) -> int:
    """Code one answer with the n contexts that were set, and learn from it."""
    contexts = w[CONTEXTS]
    seen = contexts + 2 * MOST_CONTEXTS
    odds = seen + MOST_CONTEXTS
    weights = w[WEIGHTS] + MOST_CONTEXTS * question
    total = 0
    for i in range(n):
        tag = _COUNTS | i << 5 | question << 8 | step << 16 | w[contexts + 2 * i] << 24
        at = place_of(w, tag, w[contexts + 2 * i + 1])
        x = _LOGARITHMS[w[at] >> 16] - _LOGARITHMS[w[at] & 0xFFFF]
        w[seen + i] = at
        w[odds + i] = x
        total += w[weights + i] * x
    logit = max(-LARGEST_LOGIT, min(LARGEST_LOGIT, total >> 16))
    chance = _CHANCES[logit + LARGEST_LOGIT]
    answer = code_odds(w, words, chance, value)
    surprise = 3 * ((65536 if answer else 0) - chance)
    for i in range(n):
        w[weights + i] += (w[odds + i] * surprise) >> 16
        at = w[seen + i]
        no, yes = w[at] & 0xFFFF, w[at] >> 16
        if answer:
            yes += 1
            if no > 2:
                no = (no + 2) // 2
        else:
            no += 1
            if yes > 2:
                yes = (yes + 2) // 2
        if no + yes > MOST_COUNTED:
            no //= 2
            yes //= 2
        w[at] = yes << 16 | no
    return answer


@kernel
def code_number(w: Any, words: Any, bits: Any, question: int, n: int, value: int) -> int:
    """Code a number >= 0 with the n contexts that were set."""
    length = 0
    while (value + 1) >> (length + 1):
        length += 1
    step = 0
    while ask(w, words, question, step, n, 1 if step < length else 0):
        step += 1
        if step > WIDEST_NUMBER or w[STATUS]:
            fail(w, ENDLESS)
            return 0
    low = code_bits(w, bits, step, value + 1 - (1 << step))
    return (1 << step) - 1 + low
