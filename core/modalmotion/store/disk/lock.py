"""The lock on a store's folder: one process at a time."""

from __future__ import annotations

import fcntl
import os
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Final

from modalmotion.errors import StoreError

_held: Final[weakref.WeakSet[FolderLock]] = weakref.WeakSet()


class FolderLock:
    """An exclusive lock on a file, which goes with the process that holds it.

    Parameters
    ----------
    path : Path
        The file; it is made where it is missing and stays there.

    Raises
    ------
    StoreError
        If another process (or another store of this one) holds it, naming its process id.
    """

    def __init__(self, path: Path) -> None:
        _close_in_children()
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise StoreError(
                f"The folder of the store cannot be opened: {error.strerror}.",
                remedy="Give this user the right to write there.",
            ) from error
        try:
            # flock rather than POSIX locks, which one process may take twice.
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(descriptor, 20, 0).decode(errors="replace").strip()
            os.close(descriptor)
            raise StoreError(
                f"The store's folder is in use by process {holder or 'unknown'}.",
                remedy="Stop that process, or use another folder: one process has a folder "
                "to itself.",
                details={"pid": int(holder)} if holder.isdigit() else {},
            ) from None
        except OSError as error:
            os.close(descriptor)
            raise StoreError(
                f"The store's folder cannot be locked: {error.strerror}.",
                remedy="Put the store on a file system with locks, best a local one.",
            ) from error
        self._descriptor: int | None = descriptor
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        _held.add(self)

    @property
    def is_held(self) -> bool:
        """Whether this process still holds the lock: a forked child does not."""
        return self._descriptor is not None

    def release(self) -> None:
        """Give the lock back."""
        _held.discard(self)
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)


@contextmanager
def folder_lock(path: Path) -> Iterator[None]:
    """Hold the lock inside the block."""
    lock = FolderLock(path)
    try:
        yield
    finally:
        lock.release()


@cache
def _close_in_children() -> None:
    # A worker forked from a server would otherwise keep the lock when the server is killed.
    os.register_at_fork(after_in_child=_release_all)


def _release_all() -> None:
    for lock in list(_held):
        lock.release()
