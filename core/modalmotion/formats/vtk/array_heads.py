"""Heads of the binary arrays of a .vtp file: the sizes that VTK allocates by.

An array of numbers is preceded by its number of bytes; a compressed one by the number of its
blocks, the size of each when unpacked and that of the last (VTK's file formats, XML).
"""

from __future__ import annotations

import binascii
import struct
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

from modalmotion.errors import MalformedFileError
from modalmotion.limits import ReadLimits

_malformed: Final = partial(
    MalformedFileError, remedy="Save the frame again as a polygonal surface (vtkPolyData)."
)

_ITEM_BYTES: Final = {
    f"{kind}{bits}": bits // 8 for kind in ("Int", "UInt", "Float") for bits in (8, 16, 32, 64)
}


@dataclass
class ArrayHeads:
    """Reads heads, and adds up what they declare.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits
        On a file of that size: `decompressed_bytes` applies to all arrays together.
    word_bytes : int
        Of a number in a head.
    order : {"<", ">"}
        Of its bytes, the least or the greatest first.
    is_compressed : bool
    """

    data: bytes
    limits: ReadLimits
    word_bytes: int = 4
    order: str = "<"
    is_compressed: bool = False
    n_bytes: int = 0

    def require(self, name: str, kind: str, n_values: int, at: int, *, is_raw: bool) -> None:
        """Refuse an array whose head declares more than its file or its element can contain.

        Parameters
        ----------
        name, kind : str
            Of the array, and of its numbers.
        n_values : int
            That its element declares; 0 where it declares none.
        at : int
            First byte of the head.
        is_raw : bool
            Bytes as they are, and not in base64.

        Raises
        ------
        MalformedFileError, LimitError
        """
        n_words = 3 if self.is_compressed else 1
        words = self._words(at, n_words, is_raw=is_raw)
        if words is None:
            raise _malformed(f"The array {name[:40]!r} of the .vtp file has no readable head.")
        n_bytes, n_heads = words[0], 0
        if self.is_compressed:
            n_blocks, block, last = words
            n_bytes = max(0, n_blocks - bool(last)) * block + last
            # The head goes on with the packed size of each block.
            n_heads = n_blocks * self.word_bytes
        # More than its element states, or than there is where nothing is packed.
        room = n_values * _ITEM_BYTES.get(kind, 0) or n_bytes
        if not self.is_compressed:
            room = min(room, len(self.data))
        if n_bytes > room or n_heads > len(self.data):
            raise _malformed(
                f"The array {name[:40]!r} of the .vtp file begins with {words}: {n_bytes} bytes, "
                f"more than its element or its file of {len(self.data)} bytes can contain."
            )
        self.n_bytes += n_bytes
        self.limits.require("decompressed_bytes", self.n_bytes)

    def _words(self, at: int, n: int, *, is_raw: bool) -> tuple[int, ...] | None:
        n_bytes = n * self.word_bytes
        head = self.data[at : at + n_bytes] if is_raw else b""
        if not is_raw:
            # Three bytes in four letters.
            with suppress(binascii.Error):
                head = binascii.a2b_base64(self.data[at : at + 4 * -(-n_bytes // 3)])
        if len(head) < n_bytes:
            return None
        return struct.unpack_from(f"{self.order}{n}{'Q' if self.word_bytes == 8 else 'I'}", head)
