"""Streams decoded by the compiled decoder, which browsers run too."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.native import library

ROOM = 17
"""The status of too little room."""

LARGEST = 1 << 27
"""Bytes of room that no stream of the tests may need."""


class Whole(NamedTuple):
    positions: NDArray[np.floating]
    faces: NDArray[np.uint32]
    times: NDArray[np.float64]


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def whole(data: bytes, first: int = 0, stop: int | None = None) -> Whole | int:
    """Decode some frames, or give the status of the failure."""
    stream, facts = np.frombuffer(data, np.uint8), np.zeros(32)
    given = pointer(stream), ctypes.c_size_t(len(data))
    status = library().mm_inspect(*given, pointer(facts))
    if status:
        return int(status)
    n_frames, n_vertices, n_faces, is_double = map(int, facts[:4])
    n = (n_frames if stop is None else stop) - first
    dtype = np.float64 if is_double else np.float32
    made = Whole(
        np.zeros((n, n_vertices, 3), dtype), np.zeros((n_faces, 3), np.uint32), np.zeros(n)
    )
    span, needed, size = (ctypes.c_size_t(first), ctypes.c_size_t(n)), np.zeros(1), 1 << 16
    while True:
        room = np.empty(size, dtype=np.uint8)
        status = library().mm_decode(
            *given,
            *span,
            *map(pointer, made),
            pointer(room),
            ctypes.c_size_t(size),
            pointer(needed),
        )
        if status != ROOM:
            return int(status) or made
        size = max(2 * size, int(needed[0]))
        assert size <= LARGEST, f"{size} bytes for {n_vertices} vertices"
