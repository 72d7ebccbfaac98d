"""Quantised coefficients: a matrix of whole numbers, coded in the order of its diagonals.

Rows are what moves (temporal components, strongest first), columns are modes (smoothest
first), so magnitudes fall off to the right and downwards, and what is near says how large
the next one will be.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.bits.entropy import (
    ESCAPE,
    N_CLASSES,
    N_SYMBOLS,
    Coder,
    Ints,
    Tables,
    code_numbers,
    code_signs,
)
from modalmotion.codec.machine.image import Image, image
from modalmotion.codec.machine.layout import PARAMETERS
from modalmotion.codec.machine.memory import call

WIDEST_BAND: Final = 64
LARGEST_SEEN: Final = 1023
N_CONTEXTS: Final = 44

# Half width of a window; weights of each magnitude in it one, two and three rows above.
WINDOWS: Final = (
    (0, (60, 0, 0)),
    (1, (24, 12, 14)),
    (6, (8, 5, 5)),
    (32, (1, 0, 0)),
)
# Of the mean magnitude in the first and the second band to the left, in 1/64.
LEFT: Final = (3, 1)


def band_edges(n_columns: int) -> Ints:
    """First columns of the bands, and the end: 4, 4, 8, 8, 16, 16, 32, 32, 64, 64, ... wide."""
    edges, width = [0], 4
    while edges[-1] < n_columns:
        edges.append(min(n_columns, edges[-1] + width))
        if len(edges) % 2:
            width = min(WIDEST_BAND, 2 * width)
    return np.array(edges, dtype=np.int64)


def contexts_of(expected: Ints) -> Ints:
    """Two contexts for each doubling of the expected magnitude, (n,) int64.

    Parameters
    ----------
    expected : (n,) int64
        In 1/512.
    """
    value = expected + 2
    n = np.frexp(value.astype(np.float64))[1].astype(np.int64) - 1
    half = (value >> (n - 1)) & 1
    return np.minimum(2 * n - 2 + half, N_CONTEXTS - 1)


@cache
def _start() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Start each context from a geometric distribution of its own expected magnitude.

    Only + - * / of float64 are used: the tables are the same everywhere.
    """
    symbols = np.empty((N_CONTEXTS, N_SYMBOLS))
    classes = np.empty((N_CONTEXTS, N_CLASSES))
    context = np.arange(N_CONTEXTS)
    mean = (2 + context % 2) * np.ldexp(1.25, context // 2) / 512.0
    ratio = mean / (1.0 + mean)
    left = np.ones(N_CONTEXTS)
    for symbol in range(N_SYMBOLS):
        share = left * (1.0 - ratio) if symbol < ESCAPE else left
        symbols[:, symbol] = 1.0 + np.floor(share * 512.0)
        left = left * ratio
    power, left = ratio, np.ones(N_CONTEXTS)
    for n in range(N_CLASSES):
        # What exceeds the escape is geometric again: 2^n values in class n.
        classes[:, n] = 1.0 + np.floor(left * (1.0 - power) * 256.0)
        left = left * power
        power = power * power
    return symbols, classes


def start_tables() -> Tables:
    """Begin to count."""
    symbols, classes = _start()
    return Tables(symbols.copy(), classes.copy(), 24)


def code_matrix(coder: Coder, shape: tuple[int, int], values: Ints | None) -> Ints:
    """Code a matrix of whole numbers.

    Parameters
    ----------
    coder : Writer or Reader
    shape : (rows, columns)
    values : (rows, columns) int64, optional
        For a writer.

    Returns
    -------
    (rows, columns) int64
    """
    n_rows, n_columns = shape
    if not n_rows or not n_columns:
        return np.zeros(shape, dtype=np.int64)
    edges = band_edges(n_columns)
    extents = code_extents(coder, n_rows, edges, values)
    n_rows = int(np.count_nonzero(extents))
    numbers = np.zeros(shape, dtype=np.int64)
    if not n_rows:
        return numbers
    compiled = image()
    if compiled is not None:
        numbers[:n_rows] = _code_compiled(
            compiled, coder, edges, extents[:n_rows], None if values is None else values[:n_rows]
        )
        return numbers
    state = _State(edges, extents[:n_rows], n_columns)
    tables = start_tables()
    for rows, bands in _waves(extents[:n_rows]):
        widths = edges[bands + 1] - edges[bands]
        starts = np.cumsum(widths) - widths
        row = np.repeat(rows, widths)
        band = np.repeat(bands, widths)
        column = np.arange(len(row)) - np.repeat(starts - edges[bands], widths)
        contexts = contexts_of(state.expected(row, band, column))
        part = None if values is None else values[row, column]
        magnitudes = tables.code(coder, contexts, None if part is None else np.abs(part))
        state.fill(rows, bands, widths, starts, row, column, magnitudes)
        occupied = np.flatnonzero(magnitudes)
        magnitudes[occupied] *= code_signs(
            coder, len(occupied), None if part is None else part[occupied]
        )
        numbers[row, column] = magnitudes
    return numbers


def _code_compiled(
    compiled: Image, coder: Coder, edges: Ints, extents: Ints, values: Ints | None
) -> Ints:
    n_rows, n_columns, n_bands = len(extents), int(edges[-1]), len(edges) - 1
    shape = n_rows, n_columns
    numbers = np.zeros(shape, dtype=np.int64) if values is None else values
    tables = np.concatenate([part.ravel() for part in _start()])
    parts: dict[int, Ints | int] = {
        PARAMETERS + 3: edges,
        PARAMETERS + 4: extents,
        PARAMETERS + 5: numbers,
        PARAMETERS + 6: (n_rows + 3) * (n_columns + 1),
        PARAMETERS + 7: n_rows * (n_bands + 2),
        PARAMETERS + 8: 3 * min(n_rows, n_bands) * WIDEST_BAND,
        PARAMETERS + 9: N_CONTEXTS * (N_SYMBOLS + N_CLASSES + 4),
    }
    w = call(compiled, "waves", coder, (*shape, n_bands), parts, tables=tables)
    at = w[PARAMETERS + 5]
    return w[at : at + numbers.size].reshape(shape)


def code_extents(coder: Coder, n_rows: int, edges: Ints, values: Ints | None) -> Ints:
    """Code the number of bands in each row, never more than in the row above."""
    n_bands = len(edges) - 1
    drops = None
    if values is not None:
        used = np.add.reduceat(values != 0, edges[:-1], axis=1) > 0
        last = np.where(used.any(axis=1), n_bands - np.argmax(used[:, ::-1], axis=1), 0)
        drops = -np.diff(np.maximum.accumulate(last[::-1])[::-1], prepend=n_bands)
    drops = code_numbers(coder, n_rows, drops)
    extents: Ints = np.maximum(n_bands - np.cumsum(np.minimum(drops, n_bands)), 0)
    return extents


def _waves(extents: Ints) -> list[tuple[Ints, Ints]]:
    """Rows and bands of the tiles of each wave, t = band + row: all they look at is older."""
    rows = np.repeat(np.arange(len(extents)), extents)
    bands = np.arange(len(rows)) - np.repeat(np.cumsum(extents) - extents, extents)
    wave = bands + rows
    order = np.argsort(wave, kind="stable")
    cuts = np.flatnonzero(np.diff(wave[order])) + 1
    return [(rows[part], bands[part]) for part in np.split(order, cuts)]


class _State:
    """Sums of the magnitudes seen so far, weighted as each window wants them."""

    def __init__(self, edges: Ints, extents: Ints, n_columns: int) -> None:
        n_rows = len(extents)
        self._stride = n_columns + 1
        # Three rows more than there are, for what the last ones add to those below.
        self._sums = [np.zeros((n_rows + 3) * self._stride, dtype=np.int64) for _ in WINDOWS]
        self._ends = np.zeros((n_rows, len(edges)), dtype=np.int64)
        self._means = np.zeros((n_rows, len(edges) + 1), dtype=np.int64)
        self._edges = edges

    def expected(self, row: Ints, band: Ints, column: Ints) -> Ints:
        """Estimate the magnitude of each value in 1/512, (n,) int64."""
        base = row * self._stride
        # Of the rows above only what stands over this band and the ones before has been seen.
        end = base + self._edges[band + 1]
        place = base + column
        total = LEFT[0] * self._means[row, band + 1] + LEFT[1] * self._means[row, band]
        for (half, _), sums in zip(WINDOWS, self._sums, strict=True):
            total += sums.take(np.minimum(place + (half + 1), end))
            total -= sums.take(np.maximum(place - half, base))
        return total

    def fill(
        self,
        rows: Ints,
        bands: Ints,
        widths: Ints,
        starts: Ints,
        row: Ints,
        column: Ints,
        magnitudes: Ints,
    ) -> None:
        """Take in the magnitudes of some tiles."""
        seen = np.minimum(magnitudes, LARGEST_SEEN)
        running = np.cumsum(seen)
        before = running[starts] - seen[starts]
        sums = running + np.repeat(self._ends[rows, bands] - before, widths)
        last = sums[starts + widths - 1]
        self._means[rows, bands + 2] = 64 * (last - self._ends[rows, bands]) // widths
        self._ends[rows, bands + 1] = last
        place = row * self._stride + column + 1
        for (_, weights), below in zip(WINDOWS, self._sums, strict=True):
            for down, weight in enumerate(weights, start=1):
                if weight:
                    # No place twice: the tiles of a wave are in different rows.
                    below[place + down * self._stride] += weight * sums
