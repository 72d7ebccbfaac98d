"""Range coder: numbers as parts of an interval, in words of 32 bits.

The same words as the queue coder of the library constriction (R. Bamler, Understanding entropy
coding with asymmetric numeral systems, 2022), whose arithmetic this is.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.machine.layout import (
    BIT,
    FIRST,
    INVERTED,
    LOWER,
    N_BITS,
    N_CODER,
    N_WORDS,
    POINT,
    RANGE,
    READS,
    WORD,
)

Ints = NDArray[np.int64]

PRECISION: Final = 24
WHOLE: Final = 1 << PRECISION
_MASK: Final = (1 << 64) - 1
_SMALLEST: Final = 1 << 32
_LOW: Final = (1 << 32) - 1
ODDS: Final = 65536


def cuts_of(weights: NDArray[np.float64]) -> Ints:
    """Where the interval of each symbol begins, and the end, in 2^-24.

    Parameters
    ----------
    weights : (n, symbols) float64
        Whole numbers.

    Returns
    -------
    (n, symbols + 1) int64
    """
    n, m = weights.shape
    left = np.cumsum(weights, axis=1)
    cuts = np.zeros((n, m + 1), dtype=np.int64)
    scale = (WHOLE - m) / left[:, -1:]
    cuts[:, 1:m] = np.floor(left[:, :-1] * scale).astype(np.int64) + np.arange(1, m)
    cuts[:, m] = WHOLE
    return cuts


def split_of(chance: int) -> int:
    """Where yes begins, of a chance of yes in 1/65536."""
    return int((ODDS - chance) * ((WHOLE - 2) / ODDS)) + 1


class RangeCoder:
    """State of a range coder and of plain bits, which kernels may take over.

    Parameters
    ----------
    words : (words,) uint32
    plain : (bits,) uint8
        One bit each.
    """

    reads: bool

    def __init__(self, words: NDArray[np.uint32], plain: NDArray[np.uint8]) -> None:
        self.words = words
        self.plain = plain
        self.bit = 0
        self._word = 0
        self._lower, self._range, self._point = 0, _MASK, 0
        # Of a writer: words that wait for a carry, the first of them, the others all ones.
        self._n_waiting = self._waiting = 0

    @property
    def state(self) -> Ints:
        """The state as a kernel wants it, (N_CODER,) int64."""
        state = np.zeros(N_CODER, dtype=np.int64)
        state[[LOWER, RANGE, POINT]] = np.array(
            [self._lower, self._range, self._point], dtype=np.uint64
        ).view(np.int64)
        state[[WORD, N_WORDS, BIT, N_BITS]] = self._word, len(self.words), self.bit, len(self.plain)
        state[[INVERTED, FIRST, READS]] = self._n_waiting, self._waiting, self.reads
        return state

    @state.setter
    def state(self, state: Ints) -> None:
        extents = state[[LOWER, RANGE, POINT]].view(np.uint64).tolist()
        self._lower, self._range, self._point = extents
        self._word, self.bit = int(state[WORD]), int(state[BIT])
        self._n_waiting, self._waiting = int(state[INVERTED]), int(state[FIRST])


class RangeWriter(RangeCoder):
    """Write symbols."""

    reads = False

    def __init__(self) -> None:
        super().__init__(np.zeros(256, dtype=np.uint32), np.zeros(1024, dtype=np.uint8))

    def narrow(self, left: int, right: int) -> None:
        """Write the symbol from left to right of 2^24."""
        scale = self._range >> PRECISION
        lower = (self._lower + scale * left) & _MASK
        extent = scale * (right - left)
        if self._n_waiting and lower + extent <= _MASK:
            self._settle(lower < self._lower)
        if extent < _SMALLEST:
            word = lower >> 32
            lower = (lower << 32) & _MASK
            extent <<= 32
            if self._n_waiting:
                self._n_waiting += 1
            elif lower + extent <= _MASK:
                self._put(word)
            else:
                self._n_waiting, self._waiting = 1, word
        self._lower, self._range = lower, extent

    def finished_words(self) -> NDArray[np.uint32]:
        """Give all words."""
        if self._range == _MASK:
            return self.words[:0]
        n, kept = self._word, (self._n_waiting, self._waiting)
        point = self._lower + _LOW
        if self._n_waiting:
            self._settle(point > _MASK)
        last = (point & _MASK) >> 32
        self._put(last)
        if ((self._lower + self._range) & _MASK) >> 32 == last:
            self._put(0)
        words = self.words[: self._word].copy()
        self._word, (self._n_waiting, self._waiting) = n, kept
        return words

    def _settle(self, carried: bool) -> None:
        """Write the words that waited for a carry."""
        self._put(self._waiting + carried)
        for _ in range(1, self._n_waiting):
            self._put(0 if carried else _LOW)
        self._n_waiting = 0

    def _put(self, word: int) -> None:
        if self._word == len(self.words):
            self.words = np.concatenate([self.words, np.zeros_like(self.words)])
        self.words[self._word] = word
        self._word += 1


class RangeReader(RangeCoder):
    """Read symbols."""

    reads = True

    def __init__(self, words: NDArray[np.uint32], plain: NDArray[np.uint8]) -> None:
        super().__init__(words, plain)
        self._point = self._next() << 32
        self._point |= self._next()

    def quantile(self) -> int:
        """Where the point lies, in 2^-24 of the interval.

        Raises
        ------
        MalformedFileError
            If it lies beyond, as no writer leaves it.
        """
        quantile = ((self._point - self._lower) & _MASK) // (self._range >> PRECISION)
        if quantile >= WHOLE:
            raise damaged("The range coder cannot have written these words.")
        return quantile

    def narrow(self, left: int, right: int) -> None:
        """Go on behind the symbol from left to right of 2^24."""
        scale = self._range >> PRECISION
        self._lower = (self._lower + scale * left) & _MASK
        self._range = scale * (right - left)
        if self._range < _SMALLEST:
            self._lower = (self._lower << 32) & _MASK
            self._range <<= 32
            self._point = ((self._point << 32) & _MASK) | self._next()

    def _next(self) -> int:
        if self._word == len(self.words):
            return 0
        self._word += 1
        return int(self.words[self._word - 1])
