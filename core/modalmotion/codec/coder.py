"""Numbers in bytes: a range coder, plain bits, and whole numbers of few bytes.

A `Coder` writes or reads, and its methods are the same for both, so that code for both is written
once and cannot disagree with itself: a writer is given values and returns them, a reader is given
None and returns what it reads. The work is done by `native/coder.h` and its neighbours.
"""

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError, ModalMotionError
from modalmotion.numeric.native import run
from modalmotion.representation import Floats, Ints

LARGEST_MAGNITUDE: Final = (1 << 40) + 13
"""Larger ones cannot be coded."""

_N_STATE: Final = 12
_WORD, _N_WORDS, _BIT, _N_BITS, _NEEDED = 3, 4, 5, 6, 11
"""Places in the state of a coder, 64 bits each: `State` in native/coder.h."""

_FINE, _FULL, _ROOM, _KEYS = 0, 16, 17, 18
_MESSAGES: Final = {
    1: "The range coder cannot have written these words.",
    2: "A block contains fewer bits than its values need.",
    3: "A face of the stream names a vertex that does not exist.",
    4: "The stream numbers a vertex that does not exist.",
    5: "A number in the faces is not terminated.",
    6: "A matrix or a mesh is larger than can be coded.",
}
"""What a damaged stream is refused with, by the status of a function."""

_LONGEST: Final = 9


def damaged(message: str) -> MalformedFileError:
    """Make the error for bytes that no encoder writes."""
    return MalformedFileError(message, remedy="The stream is truncated or damaged: send it again.")


@contextmanager
def parsing(message: str) -> Iterator[None]:
    """Report bytes that do not parse as damage.

    Raises
    ------
    MalformedFileError
        With this message, in place of the errors of indexing and unpacking.
    """
    try:
        yield
    except ModalMotionError:
        raise
    except (IndexError, ValueError, struct.error, zlib.error) as error:
        raise damaged(message) from error


class Coder:
    """One coded part of a section, written or read.

    Almost any bytes give numbers of some kind: damage shows in the checksums.

    Parameters
    ----------
    data : bytes, optional
        To read from; a writer has none.

    Raises
    ------
    MalformedFileError
        If the bytes are too few for the words that they declare.
    """

    def __init__(self, data: bytes | None = None) -> None:
        self.reads = data is not None
        self._state = np.zeros(_N_STATE, dtype=np.int64)
        if data is None:
            self._words, self._bits = np.zeros(1024, np.uint32), np.zeros(1024, np.uint8)
        else:
            n_words, start = read_varint(data, 0)
            if n_words * 4 > len(data) - start:
                raise damaged(
                    f"A block declares {n_words} words, but {len(data) - start} bytes are left."
                )
            self._words = np.frombuffer(data, "<u4", n_words, start).astype(np.uint32)
            self._bits = np.frombuffer(data[start + 4 * n_words :], np.uint8)
        self._count_room()
        run("mm_begin", self._state, self._words, int(self.reads))

    def finish(self) -> bytes:
        """Give what was written: number of words of the range coder, the words, the plain bits."""
        self._code("mm_finish")
        words = self._words[: self._state[_WORD]].astype("<u4")
        plain = self._bits[: (self._state[_BIT] + 7) // 8]
        return write_varint(len(words)) + words.tobytes() + plain.tobytes()

    def numbers(self, count: int, values: Ints | None) -> Ints:
        """Code a list of whole numbers >= 0 that resemble each other, (count,) int64."""
        found = self._values((count,), values)
        self._code("mm_list", count, found)
        return found

    def count(self, count: int | None, most: int) -> int:
        """Code how many of some values are listed.

        Raises
        ------
        MalformedFileError
            If these are more than exist.
        """
        n = int(self.numbers(1, None if count is None else np.array([count]))[0])
        if n > most:
            raise damaged(f"The stream lists {n} of {most} values.")
        return n

    def bits(self, count: int, width: int, values: Ints | None) -> Ints:
        """Code plain numbers of so many bits each, (count,) int64."""
        found = self._values((count,), values)
        self._code("mm_bits", count, width, found)
        return found

    def signs(self, count: int, values: Ints | None) -> Ints:
        """Code the signs of values that are not zero: 1 or -1."""
        negative = None if values is None else (values < 0).astype(np.int64)
        return 1 - 2 * self.bits(count, 1, negative)

    def matrix(self, shape: tuple[int, int], values: Ints | None, *, mixed: bool) -> Ints:
        """Code a matrix of whole numbers.

        Parameters
        ----------
        shape : (rows, columns)
            Rows are what moves, the strongest first, columns are modes, the smoothest first.
        values : (rows, columns) int64, optional
            For a writer.
        mixed : bool
            Whether entries are coded one by one, in fewer bits and more time.
        """
        found = self._values(shape, values)
        self._in_room("mm_matrix", *shape, found, int(mixed))
        return found

    def faces(self, shape: tuple[int, int, int], faces: Ints | None) -> Ints:
        """Code triangles and the order of their vertices.

        Parameters
        ----------
        shape : (int, int, int)
            Vertices, faces, relations of the order.
        faces : (faces, 3) int64, optional
            For a writer.
        """
        found = np.zeros((shape[1], 3), np.int32) if faces is None else faces.astype(np.int32)
        found = np.ascontiguousarray(found)
        self._in_room("mm_faces", *shape, found)
        return found.astype(np.int64)

    def _values(self, shape: tuple[int, ...], values: Ints | None) -> Ints:
        if values is None:
            return np.zeros(shape, dtype=np.int64)
        return np.ascontiguousarray(values, dtype=np.int64)

    def _code(self, name: str, *given: Any) -> None:
        while self._run(name, *given) != _FINE:
            pass

    def _in_room(self, name: str, *given: Any) -> None:
        """Run a function that wants room, and a larger hash table if one was too small."""
        n_bytes, grow, status = 0, 0, _ROOM
        while status != _FINE:
            room = np.zeros(n_bytes, dtype=np.uint8)
            status = self._run(name, *given, grow, room, n_bytes)
            grow += status == _KEYS
            n_bytes = int(self._state[_NEEDED])

    def _run(self, name: str, *given: Any) -> int:
        """Run a function once; if words or bits are short, make room for the next time."""
        status = run(name, self._state, self._words, self._bits, *given)
        if status in _MESSAGES:
            raise damaged(_MESSAGES[status])
        if status == _FULL:
            self._words = np.concatenate([self._words, np.zeros_like(self._words)])
            self._bits = np.concatenate([self._bits, np.zeros_like(self._bits)])
            self._count_room()
        return status

    def _count_room(self) -> None:
        self._state[[_N_WORDS, _N_BITS]] = len(self._words), 8 * len(self._bits)


def write_varint(value: int) -> bytes:
    """Write a whole number >= 0, seven bits per byte, low bits first.

    The high bit of a byte says that another follows.
    """
    parts = bytearray()
    while value > 0x7F:
        parts.append(0x80 | (value & 0x7F))
        value >>= 7
    parts.append(value)
    return bytes(parts)


def read_varint(data: bytes, position: int) -> tuple[int, int]:
    """Read what `write_varint` wrote.

    Returns
    -------
    value : int
        At most 2^63 - 1.
    position : int
        Where the next byte is.

    Raises
    ------
    MalformedFileError
        If the data end inside the number, or it is longer than 63 bits.
    """
    value = 0
    for count in range(_LONGEST):
        if position >= len(data):
            break
        byte = data[position]
        position += 1
        value |= (byte & 0x7F) << (7 * count)
        if byte < 0x80:
            return value, position
    raise damaged("A number in the stream is not terminated.")


def read_varints(data: bytes, position: int, count: int) -> tuple[list[int], int]:
    """Read several numbers, as `read_varint`."""
    values = []
    for _ in range(count):
        value, position = read_varint(data, position)
        values.append(value)
    return values, position


def zigzag(value: int) -> int:
    """Map 0, -1, 1, -2, ... to 0, 1, 2, 3, ..."""
    return 2 * value if value >= 0 else -2 * value - 1


def unzigzag(value: int) -> int:
    """Undo `zigzag`."""
    return value >> 1 if value % 2 == 0 else -(value + 1) >> 1


@dataclass(frozen=True, eq=False)
class Guards:
    """Values near half-way between two multiples of the quantum, and how they were rounded.

    Parameters
    ----------
    places : (guards,) int64
        Ascending, counted over (frame, direction, vertex).
    up : (guards,) int64
        1 where the value was rounded up.
    """

    places: Ints
    up: Ints

    def round(self, scaled: Floats) -> Ints:
        """Round to whole numbers, (frames, 3, vertices) int64."""
        # In the order of the places, whatever that of the values in memory: a view, not a copy.
        whole = np.rint(scaled).astype(np.int64, order="C")
        flat = whole.reshape(-1)
        flat[self.places] = np.floor(scaled.reshape(-1)[self.places]).astype(np.int64) + self.up
        return whole


def find_guards(scaled: Floats, uncertainty: float) -> Guards:
    """List what two computations could round differently.

    Parameters
    ----------
    scaled : (frames, 3, vertices) float64
        In quanta.
    uncertainty : float
        Quanta by which another computation may differ.
    """
    flat = scaled.reshape(-1)
    places = np.flatnonzero(np.abs(flat - np.floor(flat) - 0.5) < uncertainty)
    near = flat[places]
    return Guards(places, (np.rint(near) > np.floor(near)).astype(np.int64))


def code_guards(coder: Coder, n_values: int, guards: Guards | None) -> Guards:
    """Code the list.

    Raises
    ------
    MalformedFileError
        If it names values that do not exist.
    """
    n = coder.count(None if guards is None else len(guards.places), n_values)
    width = max(1, n_values.bit_length())
    places = coder.bits(n, width, None if guards is None else guards.places)
    up = coder.bits(n, 1, None if guards is None else guards.up)
    if len(places) and (places.max() >= n_values or (np.diff(places) <= 0).any()):
        raise damaged(f"The stream lists a value outside of {n_values}, or out of order.")
    return Guards(places, up)


def code_corrections(coder: Coder, shape: tuple[int, ...], corrections: Ints | None) -> Ints:
    """Code whole steps that bring single coordinates back within the guaranteed error.

    How many there are, the gaps between them, their sizes and signs.

    Parameters
    ----------
    coder : Coder
    shape : (frames, 3, vertices)
    corrections : (frames, 3, vertices) int64, optional
        For a writer.

    Raises
    ------
    MalformedFileError
        If values are corrected that do not exist.
    """
    n_values = int(np.prod(shape))
    flat = None if corrections is None else corrections.ravel()
    places = None if flat is None else np.flatnonzero(flat)
    values = None if flat is None or places is None else flat[places]
    n = coder.count(None if places is None else len(places), n_values)
    gaps = None if places is None else np.diff(places, prepend=-1) - 1
    places = np.cumsum(coder.numbers(n, gaps) + 1) - 1
    more = coder.numbers(n, None if values is None else np.abs(values) - 1)
    signs = coder.signs(n, values)
    if n and not 0 <= int(places.min()) <= int(places.max()) < n_values:
        raise damaged(f"The stream corrects a value outside of {n_values}.")
    steps = np.zeros(n_values, dtype=np.int64)
    steps[places] = signs * (more + 1)
    return steps.reshape(shape)
