"""Members of zip archives, read no further than they declare."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.unpacking import PIECE, filled

UNREADABLE: Final = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    ValueError,
    EOFError,
    OSError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
)
"""Errors that zipfile and zlib raise on malformed bytes."""


def member_content(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[np.uint8]:
    """Read a member of the size that it declares; may raise `UNREADABLE`.

    Raises
    ------
    MalformedFileError
        If it holds more or less.
    """
    with archive.open(info) as stream:
        pieces = iter(partial(stream.read, PIECE), b"")
        return filled(pieces, info.file_size, info.compress_size)
