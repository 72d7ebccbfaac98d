"""Heads of the binary arrays of a .vtp file: the sizes that VTK allocates by.

An array of numbers is preceded by its number of bytes; a compressed one by the number of its
blocks, the size of each when unpacked and that of the last (VTK's file formats, XML).
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

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
        On a file of that size: `decompressed_bytes` holds for all arrays together.
    word_bytes : int
        Of a number in a head.
    order : {"little", "big"}
    is_compressed : bool
    """

    data: bytes
    limits: ReadLimits
    word_bytes: int = 4
    order: Literal["little", "big"] = "little"
    is_compressed: bool = False
    n_bytes: int = 0

    def require(self, name: str, kind: str, n_values: int, at: int, *, is_raw: bool) -> None:
        """Refuse an array whose head declares more than its file or its element can hold.

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
        shown = name[:40]
        n_words = 3 if self.is_compressed else 1
        words = self._words(shown, at, n_words, is_raw=is_raw)
        n_bytes = words[0]
        if self.is_compressed:
            n_blocks, block, last = words
            if n_blocks * self.word_bytes > len(self.data):
                raise _malformed(
                    f"The array {shown!r} of the .vtp file declares {n_blocks} blocks, more than "
                    f"its {len(self.data)} bytes can hold."
                )
            n_bytes = max(0, n_blocks - bool(last)) * block + last
        elif n_bytes > len(self.data):
            raise _malformed(
                f"The array {shown!r} of the .vtp file declares {n_bytes} bytes; the file has "
                f"{len(self.data)}."
            )
        stated = n_values * _ITEM_BYTES.get(kind, 0)
        if stated and n_bytes > stated:
            raise _malformed(
                f"The array {shown!r} of the .vtp file unpacks to {n_bytes} bytes and declares "
                f"{stated}."
            )
        self.n_bytes += n_bytes
        self.limits.require("decompressed_bytes", self.n_bytes)

    def _words(self, name: str, at: int, n: int, *, is_raw: bool) -> list[int]:
        n_bytes = n * self.word_bytes
        head = self.data[at : at + n_bytes]
        if not is_raw:
            # Three bytes in four letters.
            try:
                head = binascii.a2b_base64(self.data[at : at + 4 * -(-n_bytes // 3)])[:n_bytes]
            except binascii.Error:
                head = b""
        if len(head) < n_bytes:
            raise _malformed(f"The array {name!r} of the .vtp file has no readable head.")
        size = self.word_bytes
        return [int.from_bytes(head[size * i : size * (i + 1)], self.order) for i in range(n)]
