"""The folder that processes find each other by, and those that killed servers left behind."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
from functools import cache
from multiprocessing import process, util
from pathlib import Path
from typing import Final

from modalmotion.errors import StoreError

_MARK: Final = "modalmotion"
# What macOS takes as the name of a socket, which is less than Linux does, without
# "/pymp-12345678/listener-12345678".
_MOST_BYTES: Final = 103 - 32


@cache
def claim_temporary_folder() -> Path:
    """Mark the folder of this process's `multiprocessing` as ours while it lives.

    Python removes it at an orderly end. What processes that were killed have left is removed here,
    by its mark: folders of other programs look alike.

    Raises
    ------
    StoreError
        If the name of the temporary folder is too long for the sockets in it.
    """
    parent = tempfile.gettempdir()
    if len(os.fsencode(parent)) > _MOST_BYTES:
        raise StoreError(
            f"The name of the temporary folder has {len(os.fsencode(parent))} bytes, and the "
            f"sockets that processes find each other by take at most {_MOST_BYTES}.",
            remedy="Set TMPDIR to a folder with a shorter name, such as /tmp.",
        )
    _sweep(Path(parent))
    folder = Path(util.get_temp_dir())
    _mark(folder)
    return folder


def require_temporary_folder() -> bool:
    """Claim the folder, again if it was removed; false where whoever knows the old one is lost.

    Whoever calls it does so one at a time.
    """
    folder = claim_temporary_folder()
    if folder.is_dir():
        return True
    with contextlib.suppress(OSError):
        # Python removes it at the end, and complains if it cannot.
        folder.mkdir(mode=0o700)
    claim_temporary_folder.cache_clear()
    process.current_process()._config["tempdir"] = None  # type: ignore[attr-defined]
    claim_temporary_folder()
    return False


def _mark(folder: Path) -> None:
    # Locked until the process ends, however it does; closed in those that it starts. Named when it
    # is locked: a process that sweeps in between would take it for one that was left behind.
    unnamed = folder / f"{_MARK}.new"
    descriptor = os.open(unnamed, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    unnamed.rename(folder / _MARK)


def _sweep(parent: Path) -> None:
    for mark in parent.glob(f"pymp-*/{_MARK}"):
        # Another user's, or gone meanwhile.
        with contextlib.suppress(OSError):
            descriptor = os.open(mark, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            else:
                shutil.rmtree(mark.parent)
            finally:
                os.close(descriptor)
