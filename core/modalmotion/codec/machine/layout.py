"""Places in the working memory of the kernels: one array of int64, beginning with its state.

Kernels allocate nothing and know no objects. What a caller passes and what they pass on to each
other stands in this array; words and bits of the stream have arrays of their own.
"""

from __future__ import annotations

from typing import Final

LOWER: Final = 0
RANGE: Final = 1
POINT: Final = 2
"""State of the range coder, of 64 bits each."""

WORD: Final = 3
N_WORDS: Final = 4
BIT: Final = 5
N_BITS: Final = 6
"""Next word and bit, and how many there are, or have room."""

INVERTED: Final = 7
FIRST: Final = 8
"""Of a writer: how many words wait for a carry, and the first of them."""

STATUS: Final = 9
READS: Final = 10
N_CODER: Final = 11
"""What a `Coder` keeps from one kernel to the next."""

TABLE: Final = 12
CAPACITY: Final = 13
N_KEYS: Final = 14
"""Hash table: where it begins, places (a power of two), keys so far."""

WEIGHTS: Final = 15
CONTEXTS: Final = 16
"""Where the weights of the questions begin, and the contexts of the next one."""

FIRST_FREE: Final = 17
"""Where the next part of the memory goes."""

SIZE: Final = 19
"""Length of the memory itself."""

PARAMETERS: Final = 20
"""Where the parameters of one kernel begin."""

N_STATE: Final = 128
N_QUESTIONS: Final = 24
MOST_CONTEXTS: Final = 8

FINE: Final = 0
DAMAGED: Final = 1
FEW_BITS: Final = 2
NO_VERTEX: Final = 3
NO_NODE: Final = 4
ENDLESS: Final = 5
"""What a reader may meet in damaged streams."""

FULL: Final = 16
"""The words, the bits or the memory are too few: again with more."""
