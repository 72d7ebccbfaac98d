"""Numbers in lines of text, in bounded memory."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError

_BLOCK: Final = 1 << 20
_LONGEST_LINE: Final = 1 << 20


def line_blocks(data: bytes | memoryview) -> Iterator[list[bytes]]:
    """Give the lines of a text in blocks of about a megabyte.

    Splitting takes many times the memory of what is split, so it is done block by block.

    Raises
    ------
    MalformedFileError
        At a line of more than a megabyte, which no mesh has.
    """
    stream = io.BytesIO(data)
    n_lines = 0
    while lines := stream.readlines(_BLOCK):
        for number, line in enumerate(lines, n_lines + 1):
            if len(line) > _LONGEST_LINE:
                raise MalformedFileError(
                    f"Line {number} is {len(line)} bytes long.",
                    remedy="Write one vertex or one face a line.",
                    details={"line": number},
                )
        n_lines += len(lines)
        yield lines


def lines_of(data: bytes | memoryview) -> Iterator[bytes]:
    """Give the lines of a text that hold anything, without the space around them."""
    for block in line_blocks(data):
        for line in block:
            if stripped := line.strip():
                yield stripped


def parse_points(rows: list[list[bytes]]) -> NDArray[np.float64]:
    """Turn rows of three words into positions.

    Parameters
    ----------
    rows : list of list of bytes

    Returns
    -------
    (rows, 3) float64

    Raises
    ------
    ValueError
        If a row is not three numbers.
    """
    for row in rows:
        if len(row) != 3:
            raise ValueError(f"{len(row)} coordinates in place of three")
    return np.array([float(word) for row in rows for word in row]).reshape(-1, 3)
