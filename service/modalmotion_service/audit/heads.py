"""Heads of the audit log, noted beside it: what was there once shows that it is gone.

A chain of hashes shows what was changed within it, and neither that its end was cut off nor that it
was made anew. So number and digest of the last entry are noted: every hour, at each file's end and
when the log is closed, in a text file beside it, from where they go into every backup, and in the
service's own log. Whoever can write the files of the log alone cannot change those.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

from modalmotion.errors import StoreError
from modalmotion.store.disk.atomic import cannot_write, sync_folder
from modalmotion.store.index.cursor import now
from modalmotion_service.audit.entry import Place

_NAME: Final = "heads"
_PLACE: Final = re.compile(r"\b([0-9]{1,18}):([0-9a-f]{64})\b")


def note_head(folder: Path, place: Place) -> bool:
    """Append a place to the heads of a log, durably, unless it is the last one there.

    Parameters
    ----------
    folder : Path
        Of the log's files.
    place : Place

    Returns
    -------
    bool
        Whether it was new.

    Raises
    ------
    StoreError
        If it cannot be written.
    """
    path = folder / _NAME
    try:
        is_new = not path.exists()
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
        try:
            size = os.fstat(descriptor).st_size
            before = os.pread(descriptor, 200, max(0, size - 200)).decode("ascii", "replace")
            noted = _PLACE.findall(before)
            if noted and f"{noted[-1][0]}:{noted[-1][1]}" == str(place):
                return False
            # What a power cut left of a line is not gone on with.
            start = "" if before.endswith("\n") or not size else "\n"
            os.write(descriptor, f"{start}{now()} {place}\n".encode())
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        if is_new:
            sync_folder(folder)
    except OSError as error:
        raise cannot_write(path, error) from error
    return True


def heads_of(folder: Path) -> list[Place]:
    """Read the heads that were noted beside a log; none if there are none.

    Raises
    ------
    StoreError
        If they cannot be read.
    """
    path = folder / _NAME
    return places_in(path) if path.exists() else []


def has_heads(folder: Path) -> bool:
    """Tell whether there is a text for heads beside a log, be it empty."""
    return (folder / _NAME).exists()


def places_in(path: Path) -> list[Place]:
    """Find the places in a text: heads, a service's log, or what a command has printed.

    Raises
    ------
    StoreError
        If it cannot be read.
    """
    try:
        text = path.read_text("ascii", "replace")
    except OSError as error:
        raise StoreError(
            f"'{path.name}' cannot be read: {error.strerror}.",
            remedy="Give this user the right to read it.",
        ) from error
    return [Place(int(number), digest) for number, digest in _PLACE.findall(text)]
