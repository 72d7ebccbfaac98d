"""What is packed, unpacked to the size that its header declares and no further."""

import zlib
from collections.abc import Iterable, Iterator
from typing import Final, Literal

import numpy as np

from modalmotion.errors import MalformedFileError
from modalmotion.representation import Bytes

Packing = Literal["gzip", "zlib"]

_WINDOWS: Final = {"zlib": 15, "gzip": 31}
_GZIP: Final = b"\x1f\x8b"
# Sent to a decompressor at once.
_FED: Final = 1 << 16
PIECE: Final = 1 << 20
"""Bytes that are taken from a decompressor at once."""


def unpacked(data: bytes, packing: Packing, n_bytes: int, start: int = 0) -> Bytes:
    """Unpack to a declared size.

    Parameters
    ----------
    data : bytes
        Parallel writers leave several members of gzip behind one another: all count.
    packing : {"gzip", "zlib"}
    n_bytes : int
        That the header declares, checked against the limits.
    start : int
        First packed byte.

    Returns
    -------
    (n_bytes,) uint8

    Raises
    ------
    MalformedFileError
        If it unpacks to more or less, or is damaged.
    """
    return filled(_pieces(data, packing, start), n_bytes, len(data) - start)


def unpacked_head(data: bytes, packing: Packing, most: int, start: int = 0) -> bytes:
    """Unpack the first bytes, at most so many: a header that declares the rest.

    Raises
    ------
    MalformedFileError
        If it is damaged.
    """
    head = b""
    for piece in _pieces(data, packing, start):
        head += piece[: most - len(head)]
        if len(head) == most:
            break
    return head


def filled(pieces: Iterable[bytes], n_bytes: int, n_packed: int) -> Bytes:
    """Join pieces that a header declares the size of.

    Parameters
    ----------
    pieces : iterable of bytes
    n_bytes : int
        Declared size.
    n_packed : int
        Bytes that they were unpacked from.

    Raises
    ------
    MalformedFileError
        If there are more or fewer.
    """
    # Its pages are the system's until they are written to.
    plain = np.empty(n_bytes, np.uint8)
    n = 0
    for piece in pieces:
        if n + len(piece) > n_bytes:
            raise _other_size("more", n_bytes, n_packed)
        plain[n : n + len(piece)] = np.frombuffer(piece, np.uint8)
        n += len(piece)
    if n < n_bytes:
        raise _other_size(f"{n}", n_bytes, n_packed)
    # Nobody copies what cannot change.
    plain.setflags(write=False)
    return plain


def _pieces(data: bytes, packing: Packing, at: int) -> Iterator[bytes]:
    window, n_packed = _WINDOWS[packing], len(data) - at
    unpack, waiting = zlib.decompressobj(window), b""
    try:
        while waiting or at < len(data):
            if not waiting:
                waiting, at = data[at : at + _FED], at + _FED
            yield unpack.decompress(waiting, PIECE)
            waiting = unpack.unconsumed_tail
            if unpack.eof:
                waiting = unpack.unused_data
                if packing != "gzip" or (waiting + data[at : at + 2])[:2] != _GZIP:
                    return
                unpack = zlib.decompressobj(window)
        # A stream without an end: what it gave so far counts, as for the tools that write such.
        yield unpack.flush()
    except zlib.error:
        raise MalformedFileError(
            f"The {n_packed} packed bytes are damaged.", remedy="Write the file again."
        ) from None


def _other_size(held: str, n_bytes: int, n_packed: int) -> MalformedFileError:
    return MalformedFileError(
        f"The header declares {n_bytes} bytes, and the {n_packed} packed ones unpack to {held}.",
        remedy="Write the file again.",
        details={"declared": n_bytes, "packed": n_packed},
    )
