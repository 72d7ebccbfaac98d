"""Stored blocks: positions without loss, for errors finer than the numbers themselves."""

from __future__ import annotations

import lzma

import numpy as np

from modalmotion.codec.block import HASH_BYTES, digest
from modalmotion.codec.coder import damaged
from modalmotion.mesh.checks import FloatArray


def store_positions(positions: FloatArray) -> bytes:
    """Write positions without loss: bytes of equal significance together, compressed."""
    plain = positions.astype(positions.dtype.newbyteorder("<"), copy=False)
    width = plain.dtype.itemsize
    planes = np.frombuffer(np.ascontiguousarray(plain).tobytes(), np.uint8).reshape(-1, width)
    packed = lzma.compress(
        planes.T.tobytes(), format=lzma.FORMAT_ALONE, filters=[{"id": lzma.FILTER_LZMA1}]
    )
    return digest(positions) + packed


def restore_positions(
    data: bytes, n_frames: int, n_vertices: int, dtype: np.dtype[np.floating]
) -> FloatArray:
    """Undo `store_positions`, (frames, vertices, 3).

    Raises
    ------
    MalformedFileError
        If the bytes do not unpack to the positions that were stored.
    """
    shape = (n_frames, n_vertices, 3)
    n_bytes = int(np.prod(shape)) * dtype.itemsize
    try:
        inflate = lzma.LZMADecompressor(lzma.FORMAT_ALONE, memlimit=2**28)
        plain = inflate.decompress(data[HASH_BYTES:], n_bytes + 1)
    except (lzma.LZMAError, EOFError) as error:
        raise damaged("A stored block does not unpack.") from error
    if len(plain) != n_bytes:
        raise damaged(f"A stored block holds {len(plain)} bytes, not {n_bytes}.")
    planes = np.frombuffer(plain, np.uint8).reshape(dtype.itemsize, -1)
    raw = np.frombuffer(planes.T.tobytes(), dtype.newbyteorder("<"))
    positions: FloatArray = raw.astype(dtype).reshape(shape)
    if digest(positions) != data[:HASH_BYTES]:
        raise damaged("The decoded vertices are not those that were encoded.")
    return positions
