"""Calls of kernels: their working memory, filled and read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.machine.image import Image
from modalmotion.codec.machine.layout import (
    BIT,
    CAPACITY,
    CONTEXTS,
    DAMAGED,
    ENDLESS,
    FEW_BITS,
    FINE,
    FULL,
    MOST_CONTEXTS,
    N_BITS,
    N_CODER,
    N_KEYS,
    N_QUESTIONS,
    N_STATE,
    N_WORDS,
    NO_NODE,
    NO_VERTEX,
    PARAMETERS,
    READS,
    SIZE,
    TABLE,
    WEIGHTS,
    WORD,
)

Ints = NDArray[np.int64]

_Kind = TypeVar("_Kind", bound=np.generic)

MESSAGES: Final = {
    DAMAGED: "The range coder cannot have written these words.",
    FEW_BITS: "A block holds fewer bits than its values need.",
    NO_VERTEX: "A face of the stream names a vertex that does not exist.",
    NO_NODE: "The stream numbers a vertex that does not exist.",
    ENDLESS: "A number in the faces does not end.",
}
"""What a damaged stream is refused with, by the status of a kernel."""

FIRST_WEIGHT: Final = 22938
"""Of each context of each question, in 1/65536."""

_MOST_AT_FIRST: Final = 1 << 20

# No plain number is longer.
_LONGEST_BITS: Final = 64


class CoderState(Protocol):
    """What a kernel takes over from a writer or reader, and gives back.

    Parameters
    ----------
    state : (N_CODER,) int64
        As the layout says.
    words : (words,) uint32
    plain : (bits,) uint8
        One bit each.
    """

    state: Ints
    words: NDArray[np.uint32]
    plain: NDArray[np.uint8]


def call(
    image: Image,
    name: str,
    coder: CoderState,
    parameters: Sequence[int],
    parts: Mapping[int, Ints | int],
    *,
    n_keys: int = 0,
    by_key: Mapping[int, int] = MappingProxyType({}),
    n_spare: int = 0,
    tables: NDArray[np.float64] | None = None,
) -> Ints:
    """Run a kernel, again with more room where it was not enough.

    Parameters
    ----------
    image : Image
    name : str
        Of the entry.
    coder : Writer or Reader
        Goes on where the kernel ends.
    parameters : sequence of int
        The first ones of the layout.
    parts : mapping of int to array or size
        Further ones: parts of the memory, whose places these become. Of a size: zeros.
    n_keys : int, optional
        Keys that the hash table will hold, roughly; 0 without answers.
    by_key : mapping of int to int, optional
        Parts with so many numbers for each place of the hash table, and `n_spare` more.
    tables : (n,) float64, optional
        Counts of the symbols of each context; changed.

    Returns
    -------
    (n,) int64
        The memory afterwards.

    Raises
    ------
    MalformedFileError
        If a reader meets what no writer writes.
    """
    # What a stream declares costs nothing to declare: the table begins with so many at most.
    n_keys = min(n_keys, _MOST_AT_FIRST)
    capacity = 1 << max(6, (3 * n_keys // 2).bit_length()) if n_keys else 0
    started = None if tables is None else tables.copy()
    while True:
        n_answers = 3 * capacity + 3
        # A kernel that has run out of room goes on to its next check.
        sizes = {place: each * (capacity + n_spare) for place, each in by_key.items()}
        for place, part in parts.items():
            sizes[place] = part if isinstance(part, int) else part.size
        fixed = N_STATE + MOST_CONTEXTS * (N_QUESTIONS + 4)
        w = np.zeros(fixed + n_answers + sum(sizes.values()), dtype=np.int64)
        w[:N_CODER] = coder.state
        w[N_WORDS], w[N_BITS] = len(coder.words), len(coder.plain)
        w[SIZE] = len(w)
        w[PARAMETERS : PARAMETERS + len(parameters)] = parameters
        w[WEIGHTS], w[CONTEXTS] = N_STATE, N_STATE + MOST_CONTEXTS * N_QUESTIONS
        w[N_STATE : w[CONTEXTS]] = FIRST_WEIGHT
        w[TABLE], w[CAPACITY] = fixed, capacity
        at = fixed + n_answers
        for place, size in sizes.items():
            w[place] = at
            part = parts.get(place, 0)
            if not isinstance(part, int):
                w[at : at + size] = part.ravel()
            at += size
        status = image.entries[name](
            w.ctypes.data,
            coder.words.ctypes.data,
            coder.plain.ctypes.data,
            0 if tables is None else tables.ctypes.data,
        )
        if status == FINE:
            coder.state = w[:N_CODER]
            return w
        if status != FULL:
            raise damaged(MESSAGES[status])
        # More of what was short, and of that alone: the hash table is by far the largest.
        is_short = False
        if not w[READS]:
            if w[WORD] >= w[N_WORDS]:
                coder.words = _with_room(coder.words[: coder.state[WORD]], len(coder.words))
                is_short = True
            if w[BIT] + _LONGEST_BITS > w[N_BITS]:
                coder.plain = _with_room(coder.plain[: coder.state[BIT]], len(coder.plain))
                is_short = True
        if not is_short or 3 * w[N_KEYS] >= 2 * capacity:
            capacity *= 2
        if tables is not None and started is not None:
            tables[:] = started


def _with_room(used: NDArray[_Kind], n: int) -> NDArray[_Kind]:
    """Give an array with what is used of it, and room for twice as many as there were."""
    return np.concatenate([used, np.zeros(max(1024, 2 * n), dtype=used.dtype)])
