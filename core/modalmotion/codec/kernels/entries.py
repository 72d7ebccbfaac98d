"""What a caller may call, as functions of addresses."""

from __future__ import annotations

from typing import Any

from numba import carray

from modalmotion.codec.kernels.coding import code_symbol
from modalmotion.codec.kernels.halving import halve_parts
from modalmotion.codec.kernels.mixed import code_mixed
from modalmotion.codec.kernels.pairing import pair_nodes
from modalmotion.codec.kernels.surface import code_surface
from modalmotion.codec.kernels.waves import code_waves
from modalmotion.codec.machine.layout import N_BITS, N_STATE, N_WORDS, PARAMETERS, SIZE, STATUS


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


def mixed(memory: Any, words: Any, bits: Any, tables: Any) -> int:  # noqa: ARG001
    """Code a matrix by answers."""
    state = carray(memory, N_STATE)
    w = carray(memory, state[SIZE])
    stream = carray(words, max(1, state[N_WORDS]))
    plain = carray(bits, max(1, state[N_BITS]))
    code_mixed(w, stream, plain)
    return int(w[STATUS])


def surface(memory: Any, words: Any, bits: Any, tables: Any) -> int:  # noqa: ARG001
    """Code triangles and the order of the vertices."""
    state = carray(memory, N_STATE)
    w = carray(memory, state[SIZE])
    stream = carray(words, max(1, state[N_WORDS]))
    plain = carray(bits, max(1, state[N_BITS]))
    code_surface(w, stream, plain)
    return int(w[STATUS])


def halve(memory: Any, words: Any, bits: Any, tables: Any) -> int:  # noqa: ARG001
    """Halve the parts of a mesh into patches."""
    state = carray(memory, N_STATE)
    w = carray(memory, state[SIZE])
    halve_parts(w)
    return int(w[STATUS])


def pair(memory: Any, words: Any, bits: Any, tables: Any) -> int:  # noqa: ARG001
    """Pair the nodes of a graph."""
    state = carray(memory, N_STATE)
    w = carray(memory, state[SIZE])
    pair_nodes(w)
    return int(w[STATUS])


ENTRIES = (symbols, waves, mixed, surface, halve, pair)
