"""What the service and its bridge to a scheduler say to each other: bytes of a known form.

A frame is a kind (1 byte), the number of a task (8 bytes, little-endian), the length of what
follows (8 bytes), and that.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Final

PIECE: Final = 1 << 20
"""Bytes that are read at a time."""

_HEAD: Final = struct.Struct("<cQQ")


class Kind(Enum):
    """What a frame is."""

    TASK = b"t"
    """Do this; the body is a task, as `payload_of` writes it, `with_terms`."""
    CANCEL = b"c"
    """Nobody wants the task any more."""
    ANSWER = b"a"
    """The end of a task; the body is a result or an error, as `answers` writes them."""
    QUESTION = b"q"
    """Whether a worker answers now."""
    READY = b"y"
    """The answer; the body is empty if none does."""
    STATE = b"s"
    """Sent every second; the body is how many long tasks all workers do at once, and how many
    short and long ones wait for their turn; empty if the scheduler is lost."""
    REFUSAL = b"r"
    """There will be no work; the body is the error."""


@dataclass(frozen=True)
class Frame:
    """One message.

    Parameters
    ----------
    kind : Kind
    number : int
        Of the task; 0 where it is about none.
    body : bytes
    """

    kind: Kind
    number: int = 0
    body: bytes = b""

    def to_bytes(self) -> bytes:
        """Write it."""
        return _HEAD.pack(self.kind.value, self.number, len(self.body)) + self.body


class Frames:
    """Frames out of pieces of bytes as they come.

    Parameters
    ----------
    most : int
        Bytes of the largest body.
    """

    def __init__(self, most: int) -> None:
        self._data = bytearray()
        self._most = most

    def add(self, piece: bytes) -> Iterator[Frame]:
        """Give the frames that are whole with these bytes.

        Raises
        ------
        ValueError
            If they are not frames, or one is too large.
        """
        self._data += piece
        while len(self._data) >= _HEAD.size:
            kind, number, length = _HEAD.unpack_from(self._data)
            end = _HEAD.size + length
            if length > self._most:
                raise ValueError(f"{length} bytes are announced")
            if len(self._data) < end:
                return
            body = bytes(self._data[_HEAD.size : end])
            del self._data[:end]
            yield Frame(Kind(kind), number, body)
