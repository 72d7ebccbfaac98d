"""Entropy coding: one range coder and one store of plain bits, in both directions.

`Writer` and `Reader` have the same methods, so that code for both is written once
and cannot disagree with itself: a writer takes the values and returns them, a reader takes only
their number and returns what it reads.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.bits.range_coder import WHOLE, RangeReader, RangeWriter, cuts_of, split_of
from modalmotion.codec.bits.varint import read_varint, write_varint
from modalmotion.codec.machine.image import image
from modalmotion.codec.machine.layout import PARAMETERS
from modalmotion.codec.machine.memory import CoderState, call

Ints = NDArray[np.int64]

ESCAPE: Final = 15
"""Magnitudes below this are symbols of their own; this one announces a larger magnitude."""

N_SYMBOLS: Final = 16
N_CLASSES: Final = 40
LARGEST_MAGNITUDE: Final = (1 << N_CLASSES) + ESCAPE - 2
"""Of the last class: larger ones cannot be coded."""

_AT_ONCE: Final = 1 << 16


class Coder(CoderState, Protocol):
    """What `Writer` and `Reader` have in common."""

    reads: bool

    def symbols(self, weights: NDArray[np.float64], values: Ints | None) -> Ints:
        """Code one symbol for each row of weights, (values, symbols) float64."""

    def answer(self, chance: int, value: bool | None) -> bool:
        """Code yes or no, yes with a chance in 1/65536."""

    def bits(self, widths: Ints, values: Ints | None) -> Ints:
        """Code plain numbers, each of its width in bits."""


class Writer(RangeWriter):
    """Collect symbols and bits, then give the bytes."""

    def symbols(self, weights: NDArray[np.float64], values: Ints | None) -> Ints:
        """Write one symbol for each row of weights."""
        assert values is not None  # noqa: S101 - for the type checker
        if _code_compiled(self, weights, values):
            return values
        for start in range(0, len(values), _AT_ONCE):
            rows = slice(start, start + _AT_ONCE)
            cuts = cuts_of(weights[rows])
            at = np.arange(len(cuts)), values[rows]
            after = np.arange(len(cuts)), values[rows] + 1
            for left, right in zip(cuts[at].tolist(), cuts[after].tolist(), strict=True):
                self.narrow(left, right)
        return values

    def answer(self, chance: int, value: bool | None) -> bool:
        """Write yes or no."""
        assert value is not None  # noqa: S101 - for the type checker
        split = split_of(chance)
        self.narrow(*((split, WHOLE) if value else (0, split)))
        return value

    def bits(self, widths: Ints, values: Ints | None) -> Ints:
        """Write plain numbers, high bits first."""
        assert values is not None  # noqa: S101 - for the type checker
        which, shift = _places(widths)
        end = self.bit + len(which)
        if end > len(self.plain):
            self.plain = np.concatenate([self.plain, np.zeros(2 * end, dtype=np.uint8)])
        self.plain[self.bit : end] = (values[which] >> shift) & 1
        self.bit = end
        return values

    def finish(self) -> bytes:
        """Give everything that was written.

        Returns
        -------
        bytes
            Number of words of the range coder, the words, the plain bits.
        """
        words = self.finished_words().astype("<u4")
        plain = np.packbits(self.plain[: self.bit])
        return write_varint(len(words)) + words.tobytes() + plain.tobytes()


class Reader(RangeReader):
    """Read back what a `Writer` wrote.

    Almost any bytes give symbols of some kind: damage shows in the checksums.
    """

    def __init__(self, data: bytes) -> None:
        n_words, start = read_varint(data, 0)
        if n_words * 4 > len(data) - start:
            raise damaged(
                f"A block declares {n_words} words, but {len(data) - start} bytes are left."
            )
        words = np.frombuffer(data, "<u4", n_words, start).astype(np.uint32)
        plain = np.unpackbits(np.frombuffer(data, np.uint8, offset=start + 4 * n_words))
        super().__init__(words, plain)

    def symbols(self, weights: NDArray[np.float64], values: Ints | None = None) -> Ints:  # noqa: ARG002
        """Read one symbol for each row of weights."""
        symbols = np.zeros(len(weights), dtype=np.int64)
        if _code_compiled(self, weights, symbols):
            return symbols
        for i, cuts in enumerate(map(cuts_of, weights[:, None])):
            symbols[i] = symbol = int(np.searchsorted(cuts[0], self.quantile(), side="right")) - 1
            self.narrow(int(cuts[0, symbol]), int(cuts[0, symbol + 1]))
        return symbols

    def answer(self, chance: int, value: bool | None = None) -> bool:  # noqa: ARG002
        """Read yes or no."""
        split = split_of(chance)
        is_yes = self.quantile() >= split
        self.narrow(*((split, WHOLE) if is_yes else (0, split)))
        return is_yes

    def bits(self, widths: Ints, values: Ints | None = None) -> Ints:
        """Read plain numbers.

        Raises
        ------
        MalformedFileError
            If fewer bits are left.
        """
        which, shift = _places(widths)
        end = self.bit + len(which)
        if end > len(self.plain):
            raise damaged("A block holds fewer bits than its values need.")
        values = np.zeros(len(widths), dtype=np.int64)
        np.add.at(values, which, self.plain[self.bit : end].astype(np.int64) << shift)
        self.bit = end
        return values


def _code_compiled(coder: Writer | Reader, weights: NDArray[np.float64], values: Ints) -> bool:
    """Code symbols in compiled code, if there is any; a reader's go into the values."""
    compiled = image()
    if compiled is None:
        return False
    n_symbols = weights.shape[1]
    for start in range(0, len(values), _AT_ONCE):
        part = values[start : start + _AT_ONCE]
        cuts = cuts_of(weights[start : start + _AT_ONCE])
        parts = {PARAMETERS + 2: part, PARAMETERS + 3: cuts}
        w = call(compiled, "symbols", coder, (len(part), n_symbols), parts)
        at = w[PARAMETERS + 2]
        part[:] = w[at : at + len(part)]
    return True


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
