"""Members of zip archives, read no further than they declare."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from typing import Final

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
"""What zipfile and zlib raise on bytes that are not what they say."""


def member_content(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    """Read a member, at most one byte past the size that it declares; may raise `UNREADABLE`."""
    with archive.open(info) as stream:
        return stream.read(info.file_size + 1)
