"""Whole numbers in as few bytes as they need."""

from __future__ import annotations

from typing import Final

from modalmotion.codec.bits.damage import damaged

_LONGEST: Final = 9


def write_varint(value: int) -> bytes:
    """Write a whole number >= 0, seven bits a byte, low bits first.

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
    raise damaged("A number in the stream does not end.")


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
