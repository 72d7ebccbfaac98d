"""Entropy coding: one range coder and one store of plain bits, in both directions.

`Writer` and `Reader` have the same methods, so that code for both is written once
and cannot disagree with itself: a writer takes the values and returns them, a reader takes only
their number and returns what it reads.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.bits.varint import read_varint, write_varint
from modalmotion.errors import needs_extra

Ints = NDArray[np.int64]

ESCAPE: Final = 15
"""Magnitudes below this are symbols of their own; this one announces a larger magnitude."""

N_SYMBOLS: Final = 16
N_CLASSES: Final = 40
LARGEST_MAGNITUDE: Final = (1 << N_CLASSES) + ESCAPE - 2
"""Of the last class: larger ones cannot be coded."""


def _constriction() -> Any:
    # Imported where it is used: the library itself needs numpy and scipy only.
    with needs_extra("codec"):
        return import_module("constriction").stream


class Coder(Protocol):
    """What `Writer` and `Reader` have in common."""

    reads: bool

    def symbols(self, weights: NDArray[np.float64], values: Ints | None) -> Ints:
        """Code one symbol for each row of weights, (values, symbols) float64."""

    def answer(self, chance: int, value: bool | None) -> bool:
        """Code yes or no, yes with a chance in 1/65536."""

    def bits(self, widths: Ints, values: Ints | None) -> Ints:
        """Code plain numbers, each of its width in bits."""


class Writer:
    """Collect symbols and bits, then give the bytes."""

    reads = False

    def __init__(self) -> None:
        stream = _constriction()
        self._family = stream.model.Categorical(perfect=False)
        self._coder = stream.queue.RangeEncoder()
        self._bits: list[NDArray[np.uint8]] = []

    def symbols(self, weights: NDArray[np.float64], values: Ints | None) -> Ints:
        """Write one symbol for each row of weights."""
        assert values is not None  # noqa: S101 - for the type checker
        if len(values):
            self._coder.encode(values.astype(np.int32), self._family, weights)
        return values

    def answer(self, chance: int, value: bool | None) -> bool:
        """Write yes or no."""
        assert value is not None  # noqa: S101 - for the type checker
        symbol = np.array([value], dtype=np.int32)
        self._coder.encode(symbol, self._family, _odds(chance))
        return value

    def bits(self, widths: Ints, values: Ints | None) -> Ints:
        """Write plain numbers, high bits first."""
        assert values is not None  # noqa: S101 - for the type checker
        which, shift = _places(widths)
        self._bits.append(((values[which] >> shift) & 1).astype(np.uint8))
        return values

    def finish(self) -> bytes:
        """Give everything that was written.

        Returns
        -------
        bytes
            Number of words of the range coder, the words, the plain bits.
        """
        words = np.asarray(self._coder.get_compressed(), dtype="<u4")
        plain = np.packbits(np.concatenate([np.zeros(0, np.uint8), *self._bits]))
        return write_varint(len(words)) + words.tobytes() + plain.tobytes()


class Reader:
    """Read back what a `Writer` wrote.

    Almost any bytes give symbols of some kind: damage shows in the checksums.
    """

    reads = True

    def __init__(self, data: bytes) -> None:
        stream = _constriction()
        n_words, start = read_varint(data, 0)
        if n_words * 4 > len(data) - start:
            raise damaged(
                f"A block declares {n_words} words, but {len(data) - start} bytes are left."
            )
        words = np.frombuffer(data, "<u4", n_words, start).astype(np.uint32)
        self._family = stream.model.Categorical(perfect=False)
        self._coder = stream.queue.RangeDecoder(words)
        self._plain = np.unpackbits(np.frombuffer(data, np.uint8, offset=start + 4 * n_words))
        self._position = 0

    def symbols(self, weights: NDArray[np.float64], values: Ints | None = None) -> Ints:  # noqa: ARG002
        """Read one symbol for each row of weights."""
        if not len(weights):
            return np.zeros(0, dtype=np.int64)
        return self._decode(weights)

    def answer(self, chance: int, value: bool | None = None) -> bool:  # noqa: ARG002
        """Read yes or no."""
        return bool(self._decode(_odds(chance))[0])

    def _decode(self, weights: NDArray[np.float64]) -> Ints:
        try:
            symbols: Ints = self._coder.decode(self._family, weights).astype(np.int64)
        except AssertionError as error:
            raise damaged("The range coder cannot have written these words.") from error
        return symbols

    def bits(self, widths: Ints, values: Ints | None = None) -> Ints:
        """Read plain numbers.

        Raises
        ------
        MalformedFileError
            If fewer bits are left.
        """
        which, shift = _places(widths)
        end = self._position + len(which)
        if end > len(self._plain):
            raise damaged("A block holds fewer bits than its values need.")
        values = np.zeros(len(widths), dtype=np.int64)
        np.add.at(values, which, self._plain[self._position : end].astype(np.int64) << shift)
        self._position = end
        return values


def _odds(chance: int) -> NDArray[np.float64]:
    """Weights of no and yes, (1, 2) float64."""
    return np.array([[65536.0 - chance, chance]])


def _places(widths: Ints) -> tuple[Ints, Ints]:
    """Find the number each bit belongs to, and its place in it."""
    which = np.repeat(np.arange(len(widths)), widths)
    ends = np.cumsum(widths)
    return which, ends[which] - 1 - np.arange(len(which))


class Tables:
    """Adaptive distributions of magnitudes, one for each context.

    A magnitude below 15 is one symbol; a larger one is the symbol 15, then the class n of
    what exceeds it, e = magnitude - 15 with 2^n <= e + 1 < 2^(n + 1), then n plain bits.

    Parameters
    ----------
    symbols : (contexts, 16) float64
        Whole numbers: counts on top of a start.
    classes : (contexts, 40) float64
    """

    def __init__(
        self, symbols: NDArray[np.float64], classes: NDArray[np.float64], increment: int
    ) -> None:
        self._symbols = symbols
        self._classes = classes
        self._increment = increment

    def code(self, coder: Coder, contexts: Ints, values: Ints | None) -> Ints:
        """Code magnitudes, then count them.

        Parameters
        ----------
        coder : Writer or Reader
        contexts : (values,) int64
        values : (values,) int64, optional
            Magnitudes, for a writer.
        """
        small = None if values is None else np.minimum(values, ESCAPE)
        small = coder.symbols(self._symbols[contexts], small)
        self._count(self._symbols, contexts, small)
        large = np.flatnonzero(small == ESCAPE)
        if not len(large):
            return small
        magnitudes = small.copy()
        excess = None if values is None else values[large] - ESCAPE + 1
        n = None if excess is None else np.frexp(excess.astype(np.float64))[1].astype(np.int64) - 1
        n = coder.symbols(self._classes[contexts[large]], n)
        self._count(self._classes, contexts[large], n)
        low = coder.bits(n, None if excess is None else excess - (1 << n))
        magnitudes[large] = ESCAPE - 1 + (1 << n) + low
        return magnitudes

    def _count(self, table: NDArray[np.float64], contexts: Ints, values: Ints) -> None:
        width = table.shape[1]
        counts = np.bincount(contexts * width + values, minlength=table.size)
        table += self._increment * counts.reshape(table.shape)


def flat_tables(n_contexts: int = 1) -> Tables:
    """Start without knowledge: small magnitudes a little likelier."""
    start = np.array([max(1, 24 >> (i // 2)) for i in range(N_SYMBOLS)], dtype=np.float64)
    classes = np.array([max(1, 8 >> (i // 2)) for i in range(N_CLASSES)], dtype=np.float64)
    return Tables(np.tile(start, (n_contexts, 1)), np.tile(classes, (n_contexts, 1)), 24)


def code_numbers(coder: Coder, count: int, values: Ints | None) -> Ints:
    """Code a list of whole numbers >= 0 that resemble each other.

    They go in batches of 8, 8, 16, 32, 64, ...: the distribution is that of all before.
    """
    tables = flat_tables()
    numbers = np.zeros(count, dtype=np.int64)
    start, size = 0, 8
    while start < count:
        stop = min(count, start + size)
        part = None if values is None else values[start:stop]
        numbers[start:stop] = tables.code(coder, np.zeros(stop - start, dtype=np.int64), part)
        start, size = stop, max(8, stop)
    return numbers


def code_count(coder: Coder, count: int | None, most: int) -> int:
    """Code how many of some values are listed.

    Raises
    ------
    MalformedFileError
        If these are more than exist.
    """
    n = int(code_numbers(coder, 1, None if count is None else np.array([count]))[0])
    if n > most:
        raise damaged(f"The stream lists {n} of {most} values.")
    return n


def code_signs(coder: Coder, count: int, values: Ints | None) -> Ints:
    """Code the signs of values that are not zero, one bit each: 1 or -1."""
    negative = None if values is None else (values < 0).astype(np.int64)
    return 1 - 2 * coder.bits(np.ones(count, dtype=np.int64), negative)
