"""What a caller may call, as functions of addresses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import carray

from modalmotion.codec.kernels.coding import code_symbol
from modalmotion.codec.kernels.halving import halve_parts
from modalmotion.codec.kernels.mixed import code_mixed
from modalmotion.codec.kernels.pairing import pair_nodes
from modalmotion.codec.kernels.surface import code_surface
from modalmotion.codec.kernels.waves import code_waves
from modalmotion.codec.machine.layout import N_BITS, N_STATE, N_WORDS, PARAMETERS, SIZE, STATUS

Entry = Callable[[Any, Any, Any, Any], int]


def symbols(memory: Any, words: Any, bits: Any, tables: Any) -> int:  # noqa: ARG001
    """Code symbols that each have boundaries of their own."""
    state = carray(memory, N_STATE)
    w = carray(memory, state[SIZE])
    stream = carray(words, max(1, state[N_WORDS]))
    n, width = state[PARAMETERS], state[PARAMETERS + 1]
    values, cuts = state[PARAMETERS + 2], state[PARAMETERS + 3]
    for i in range(n):
        value = code_symbol(w, stream, w, cuts + i * (width + 1), width, w[values + i])
        w[values + i] = value
    return int(w[STATUS])


def waves(memory: Any, words: Any, bits: Any, tables: Any) -> int:
    """Code a matrix in waves."""
    state = carray(memory, N_STATE)
    w = carray(memory, state[SIZE])
    stream = carray(words, max(1, state[N_WORDS]))
    plain = carray(bits, max(1, state[N_BITS]))
    code_waves(w, stream, plain, carray(tables, 4096))
    return int(w[STATUS])


def _of_answers(name: str, code: Callable[[Any, Any, Any], None]) -> Entry:
    """Make the entry of a kernel that codes answers and plain bits."""

    def entry(memory: Any, words: Any, bits: Any, tables: Any) -> int:  # noqa: ARG001
        state = carray(memory, N_STATE)
        w = carray(memory, state[SIZE])
        stream = carray(words, max(1, state[N_WORDS]))
        plain = carray(bits, max(1, state[N_BITS]))
        code(w, stream, plain)
        return int(w[STATUS])

    entry.__name__ = name
    return entry


def _of_memory(name: str, work: Callable[[Any], None]) -> Entry:
    """Make the entry of a kernel that codes nothing."""

    def entry(memory: Any, words: Any, bits: Any, tables: Any) -> int:  # noqa: ARG001
        state = carray(memory, N_STATE)
        w = carray(memory, state[SIZE])
        work(w)
        return int(w[STATUS])

    entry.__name__ = name
    return entry


ENTRIES = (
    symbols,
    waves,
    _of_answers("mixed", code_mixed),
    _of_answers("surface", code_surface),
    _of_memory("halve", halve_parts),
    _of_memory("pair", pair_nodes),
)
