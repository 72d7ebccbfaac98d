"""Machine code in a file: checked, mapped into memory, called.

An image is code without addresses, which calls nothing outside of itself: neither numba nor any
other library is needed to run it, and mapping it takes a millisecond. Compiling takes a minute,
so it is done once, by `modalmotion compile-codec`, and kept in a folder that may be read-only.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import logging
import mmap
import os
import platform
import sys
import sysconfig
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError

VARIABLE: Final = "MODALMOTION_KERNELS"
"""Environment variable: the folder of the images, or `off`."""

OFF: Final = "off"
_MAGIC: Final = b"MMKERNEL"
_HEAD: Final = 44
"""Bytes of the magic, the hash of all behind it, and the length of the table of entries."""

_PAGE: Final = 4096

_log = logging.getLogger(__name__)

Entry = Callable[..., int]
"""Takes addresses and whole numbers as int, and numbers as float."""


@dataclass(frozen=True, eq=False)
class Image:
    """Mapped code and its entries."""

    entries: dict[str, Entry]
    # Keeps the pages where they are.
    pages: mmap.mmap = field(repr=False)


def is_served() -> bool:
    """Tell whether code for this machine can be made: x86-64 with the calls of Unix."""
    return platform.machine() in ("x86_64", "AMD64") and sys.platform in ("linux", "darwin")


def folders() -> list[Path]:
    """Folders to look for images in; the first that can be written to takes a new one."""
    stated = os.environ.get(VARIABLE)
    if stated:
        return [] if stated == OFF else [Path(stated)]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return [Path(sysconfig.get_path("data"), "share", "modalmotion"), cache / "modalmotion"]


def digest_of(root: Path, sources: Sequence[str]) -> str:
    """Digest of the sources of kernels: paths below a folder, in whose names * may stand."""
    digest = hashlib.sha256()
    for pattern in sources:
        # In a third of the time of Path.glob, which counts in the first decode of a process.
        name, _, stem = pattern.partition("/")
        start, star, end = stem.partition("*")
        folder = f"{root}/{name}"
        names = os.listdir(folder) if star else [stem]  # noqa: PTH208
        for file in sorted(n for n in names if n.startswith(start) and n.endswith(end)):
            with open(f"{folder}/{file}", "rb", buffering=0) as source:  # noqa: PTH123
                digest.update(file.encode() + b"\0" + source.readall())
    return digest.hexdigest()[:20]


def pack(code: bytes, entries: dict[str, int]) -> bytes:
    """Make the bytes of an image.

    Parameters
    ----------
    code : bytes
    entries : dict of int
        Where each entry begins in the code.
    """
    head = json.dumps(entries).encode()
    start = -(-(_HEAD + len(head)) // _PAGE) * _PAGE
    rest = len(head).to_bytes(4, "little") + head + bytes(start - _HEAD - len(head)) + code
    return _MAGIC + hashlib.sha256(rest).digest() + rest


def map_image(path: Path) -> Image:
    """Map an image.

    Raises
    ------
    MalformedFileError
        If the file is not a whole image.
    """
    with path.open("rb") as file:
        pages = mmap.mmap(file.fileno(), 0, mmap.MAP_PRIVATE, mmap.PROT_READ | mmap.PROT_EXEC)
    if pages[:8] != _MAGIC or hashlib.sha256(pages[40:]).digest() != pages[8:40]:
        raise _corrupt(path)
    end = _HEAD + int.from_bytes(pages[40:_HEAD], "little")
    entries = json.loads(pages[_HEAD:end])
    start = -(-end // _PAGE) * _PAGE
    base = _address(pages) + start
    make = ctypes.CFUNCTYPE(ctypes.c_int32)
    return Image({name: _entry(make(base + at)) for name, at in entries.items()}, pages)


def find_image(name: str, slower: str) -> Image | None:
    """Map the image of this name from the first folder that has it, if it is whole.

    Parameters
    ----------
    name : str
        Of the file.
    slower : str
        What the log says once where there is none, although there could be.
    """
    where = folders()
    if not where:
        return None
    for folder in where:
        try:
            return map_image(folder / name)
        except FileNotFoundError:
            continue
        except (OSError, ValueError, MalformedFileError) as error:
            _log.warning("The compiled code cannot be used: %s", error)
            return None
    if is_served():
        _log.warning(slower)
    return None


def _entry(function: Any) -> Entry:
    def call(*given: Any) -> int:
        # Numba returns a status of its own, and the value by address.
        value, raised = ctypes.c_int64(), ctypes.c_void_p()
        numbers = (ctypes.c_double(x) if isinstance(x, float) else ctypes.c_int64(x) for x in given)
        function(ctypes.byref(value), ctypes.byref(raised), *numbers)
        return value.value

    return call


def _address(pages: mmap.mmap) -> int:
    return int(np.frombuffer(pages, dtype=np.uint8).ctypes.data)


def _corrupt(path: Path) -> MalformedFileError:
    return MalformedFileError(
        f"{path} does not hold compiled code.",
        remedy="Delete it, then: modalmotion compile-codec.",
    )
