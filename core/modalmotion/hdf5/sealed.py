"""Seals: a digest behind a file's last byte, checked before anything parses the file.

A digest inside the file would be read by the HDF5 library, which is not made to survive
damaged files. Behind the end of the HDF5 image it is checked first, covers every byte, and
disturbs no reader: HDF5 files may be followed by anything.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from modalmotion.errors import CorruptFileError, NotFoundError, StoreError
from modalmotion.hdf5.gate import SIGNATURE

_MARK: Final = b"\nmodalmotion sha256 "
_SEAL: Final = re.compile(rb"\nmodalmotion sha256 ([0-9a-f]{64})\n")
SEAL_LENGTH: Final = len(_MARK) + 64 + 1

# Of a file, at a time.
_PIECE: Final = 1 << 20

_RESTORE = "Restore it from a copy, or delete it and make the result again."


def seal(pieces: Sequence[bytes | memoryview]) -> bytes:
    """Join the pieces of an HDF5 image and put the seal behind them."""
    digest = hashlib.sha256()
    for piece in pieces:
        digest.update(piece)
    return b"".join((*pieces, _MARK, digest.hexdigest().encode(), b"\n"))


def seal_file(path: Path) -> None:
    """Put the seal behind an HDF5 file that is too large to be built in memory.

    May raise OSError.
    """
    with path.open("rb+") as file:
        digest = hashlib.file_digest(file, "sha256")
        file.write(_MARK + digest.hexdigest().encode() + b"\n")


def require_sealed(path: Path) -> None:
    """Check the seal of a file a piece at a time, as `load_sealed` does in memory.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it has no seal, or differs from what was sealed.
    """
    name = f"'{path.name}'"
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            left = path.stat().st_size - SEAL_LENGTH
            while left > 0 and (piece := file.read(min(left, _PIECE))):
                digest.update(piece)
                left -= len(piece)
            match = _SEAL.fullmatch(file.read())
    except OSError as error:
        raise _unreadable(path, error) from error
    if match is None or digest.hexdigest().encode() != match[1]:
        raise CorruptFileError(
            f"{name} is damaged: its bytes do not have the sha256 of a seal at its end.",
            remedy=_RESTORE,
        )


def digest_of(data: bytes) -> str:
    """sha256 in the seal of a file, in hex."""
    return data[-65:-1].decode()


def load_sealed(source: bytes | Path) -> tuple[str, bytes]:
    """Read a sealed HDF5 file and check its seal.

    Parameters
    ----------
    source : bytes or Path

    Returns
    -------
    name : str
        The file's name without its folder, or a word for bytes that have none.
    data : bytes
        All of it, the seal included.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is not an HDF5 file, has no seal, or differs from what was sealed.
    """
    if isinstance(source, bytes):
        name, data = "the HDF5 image", source
    else:
        name = f"'{source.name}'"
        data = read_file(source)
    if not data.startswith(SIGNATURE):
        what = "is empty" if not data else "does not begin as an HDF5 file does"
        raise CorruptFileError(
            f"{_capital(name)} {what}.",
            remedy=f"Name an HDF5 file written by modalmotion. If this was one: {_RESTORE}",
        )
    match = _SEAL.fullmatch(data, max(0, len(data) - SEAL_LENGTH))
    if match is None:
        raise CorruptFileError(
            f"{_capital(name)} does not end with the seal that modalmotion writes: it is cut "
            "short, was changed, or comes from another program.",
            remedy=_RESTORE,
        )
    digest = hashlib.sha256(memoryview(data)[:-SEAL_LENGTH]).hexdigest()
    if digest.encode() != match[1]:
        raise CorruptFileError(
            f"{_capital(name)} is damaged: its bytes do not have the sha256 that its seal states.",
            remedy=_RESTORE,
            details={"stated": match[1].decode(), "found": digest},
        )
    return name, data


def is_sound(path: Path) -> bool:
    """Return whether a sealed file is there as it was written."""
    try:
        load_sealed(path)
    except StoreError:
        return False
    return True


def read_file(path: Path) -> bytes:
    """Read all of a file.

    Raises
    ------
    NotFoundError
        If there is none.
    StoreError
        If it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError) -> StoreError:
    if isinstance(error, FileNotFoundError):
        return NotFoundError(
            f"There is no file '{path.name}'.", remedy="Check its name and folder."
        )
    return StoreError(
        f"'{path.name}' could not be read: {error.strerror}.",
        remedy="Check that it is a file, that this user may read it, and the disk.",
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
