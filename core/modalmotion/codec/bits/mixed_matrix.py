"""Quantised coefficients one by one: fewer bits than in waves, for more time.

Each magnitude is coded by questions - more than 0, more than 1, ... - whose odds mix what
several contexts near it predict.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Final

import numpy as np

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.bits.entropy import Coder, Ints, code_signs
from modalmotion.codec.bits.matrix import LARGEST_SEEN, band_edges, code_extents
from modalmotion.codec.bits.mixing import Mixer
from modalmotion.codec.machine.image import Image, image
from modalmotion.codec.machine.layout import PARAMETERS
from modalmotion.codec.machine.memory import call

MOST_MIXED: Final = 2**20
"""Entries within the extents of the largest matrix that is coded so."""

N_STEPS: Final = 14
ROWS_ABOVE: Final = 6
WIDEST: Final = 30
_LARGER: Final = 20


def code_mixed_matrix(coder: Coder, shape: tuple[int, int], values: Ints | None) -> Ints:
    """Code a matrix of whole numbers; the same as `code_matrix`, in other bytes.

    Raises
    ------
    MalformedFileError
        If there are more entries than are mixed.
    """
    n_rows, n_columns = shape
    numbers = np.zeros(shape, dtype=np.int64)
    if not n_rows or not n_columns:
        return numbers
    edges = band_edges(n_columns)
    ends = edges[code_extents(coder, n_rows, edges, values)].tolist()
    if sum(ends) > MOST_MIXED:
        raise damaged(
            f"A matrix of {sum(ends)} entries is coded in a way for at most {MOST_MIXED}."
        )
    compiled = image()
    if compiled is not None:
        return _code_compiled(compiled, coder, shape, ends, values)
    mixer = Mixer(coder)
    # Rows above the first, and columns before and after, are zero.
    above = [[0] * (n_columns + 2 * WIDEST + 1)] * ROWS_ABOVE
    sums = [[0] * (n_columns + 2 * WIDEST + 2)] * 3
    for row, end in enumerate(ends):
        if not end:
            break
        exact = None if values is None else np.abs(values[row]).tolist()
        magnitudes = [0] * (n_columns + 2 * WIDEST + 1)
        running = [0] * (WIDEST + 1)
        for column in range(end):
            place = WIDEST + column
            contexts = _contexts(row, column, above, sums, magnitudes, running)
            value = None if exact is None else exact[column]
            magnitude = _code_magnitude(mixer, contexts, value)
            numbers[row, column] = magnitude
            magnitudes[place] = min(magnitude, LARGEST_SEEN)
            running.append(running[place] + magnitudes[place])
        running += [running[-1]] * (n_columns + 2 * WIDEST + 2 - len(running))
        above = [magnitudes, *above[: ROWS_ABOVE - 1]]
        sums = [running, *sums[:2]]
    occupied = np.nonzero(numbers)
    numbers[occupied] *= code_signs(
        coder, len(occupied[0]), None if values is None else values[occupied]
    )
    return numbers


def _code_compiled(
    compiled: Image, coder: Coder, shape: tuple[int, int], ends: list[int], values: Ints | None
) -> Ints:
    n_rows, n_columns = int(np.count_nonzero(ends)), shape[1]
    numbers = np.zeros(shape, dtype=np.int64)
    if not n_rows:
        return numbers
    room = (n_rows + ROWS_ABOVE) * (n_columns + 2 * WIDEST + 2)
    parts: dict[int, Ints | int] = {
        PARAMETERS + 2: np.array(ends[:n_rows]),
        PARAMETERS + 3: numbers[:n_rows] if values is None else values[:n_rows],
        PARAMETERS + 4: room,
        PARAMETERS + 5: room,
    }
    n_keys = 2 * sum(ends)
    w = call(compiled, "mixed", coder, (n_rows, n_columns), parts, n_keys=n_keys)
    at = w[PARAMETERS + 3]
    numbers[:n_rows] = w[at : at + n_rows * n_columns].reshape(n_rows, n_columns)
    return numbers


def count_questions(values: Ints) -> int:
    """Count the answers that the magnitudes of a matrix take, at most."""
    magnitudes = np.abs(values).astype(np.float64)
    beyond = magnitudes[magnitudes >= N_STEPS] - N_STEPS
    bits = np.floor(np.log2(beyond + 1.0)) + 1.0
    return int(np.minimum(magnitudes + 1.0, N_STEPS).sum() + bits.sum())


def _code_magnitude(mixer: Mixer, contexts: list[Hashable], value: int | None) -> int:
    for step in range(N_STEPS):
        if not mixer.bit(step, contexts, None if value is None else value > step):
            return step
    more = None if value is None else value - N_STEPS
    return N_STEPS + mixer.number(_LARGER, [0, contexts[0]], more)


def _contexts(
    row: int,
    column: int,
    above: list[list[int]],
    sums: list[list[int]],
    magnitudes: list[int],
    running: list[int],
) -> list[Hashable]:
    """List eight contexts from the magnitudes near."""
    x = WIDEST + column
    first, second, third = sums
    near_1 = first[x + 2] - first[x - 1]
    near_2 = second[x + 2] - second[x - 1]
    near_3 = third[x + 2] - third[x - 1]
    wide_1 = first[x + 7] - first[x - 6]
    wide_2 = second[x + 7] - second[x - 6]
    wide_3 = third[x + 7] - third[x - 6]
    left = running[x] - running[x - 8]
    far_left = running[x] - running[x - WIDEST]
    up = above[0][x]
    expected = 60 * up + 24 * near_1 + 12 * near_2 + 14 * near_3
    expected += 8 * wide_1 + 5 * wide_2 + 5 * wide_3 + 32 * left
    return [
        _size(expected),
        (_size(4 * left), _size(2 * wide_1)),
        (_size(up), _size(above[1][x]), _size(above[2][x])),
        (_size(near_1), _size(near_3)),
        (_size(far_left), _size(left)),
        (min(column, 60), row % 3),
        (_size(magnitudes[x - 1]), _size(magnitudes[x - 2]), _size(up)),
        (_size(wide_1 + wide_2 + wide_3), _size(above[5][x])),
    ]


def _size(value: int) -> int:
    """Two classes for each doubling."""
    value += 2
    n = value.bit_length() - 1
    return 2 * n - 2 + ((value >> (n - 1)) & 1)
