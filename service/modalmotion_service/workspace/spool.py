"""Uploads and unfinished results as files of the store's own disk, and the room for them."""

import asyncio
import contextlib
import errno
import hashlib
import math
import os
import secrets
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Self

from modalmotion import errors, mesh
from modalmotion.store.disk import cannot_write, make_folder, remove_durably, sync_paths
from modalmotion_service.work.upload import Part

# Some commits of SQLite, with their logs: what every answer takes, for the audit log.
LEAST_BYTES: Final = 1 << 20


def require_room(folder: Path, n_bytes: int = LEAST_BYTES) -> None:
    """Check that a folder's disk has room for something.

    Parameters
    ----------
    folder : Path
    n_bytes : int
        That must be free for this user, and one file besides.

    Raises
    ------
    StoreError
        If there is none, or the disk is gone, or mounted for reading only.
    """
    try:
        status = os.statvfs(folder)
    except OSError as error:
        raise cannot_write(folder, error) from error
    if status.f_flag & os.ST_RDONLY:
        raise _cannot_write(folder, errno.EROFS)
    # Some file systems number no files beforehand, and say 0 of 0.
    is_out_of_files = status.f_files > 0 and status.f_favail == 0
    if is_out_of_files or status.f_bavail * status.f_frsize < n_bytes:
        raise _cannot_write(folder, errno.ENOSPC)


def _cannot_write(folder: Path, number: int) -> errors.StoreError:
    return cannot_write(folder, OSError(number, os.strerror(number)))


# Of the files that the store of `local` is beside.
NOT_OF_LOCAL: Final = ("access", "owners", "cluster")
_SECONDS: Final = 10.0
# A measurement takes at most one part in so many of the time.
_PART: Final = 50


@dataclass(eq=False)
class Quota:
    """Measures the files of one owner now and then, and refuses more where they are too many.

    Parameters
    ----------
    root : Path
        Folder of the owner's store.
    most_bytes : int
        That it may hold; 0 for as much as there is room for.
    """

    root: Path
    most_bytes: int = 0
    used_bytes: int = field(default=0, init=False)

    def require(self) -> None:
        """Refuse to keep more.

        Raises
        ------
        StoreError
            If the owner's files took as much as they may when they were last measured.
        """
        if self.most_bytes and self.used_bytes >= self.most_bytes:
            raise errors.StoreError(
                f"Everything that is stored here takes {self.used_bytes:,} bytes, and may take "
                f"{self.most_bytes:,}.",
                remedy="DELETE sequences, images, tracks, templates or models that are no longer "
                "needed: a sequence goes with all its results. It counts within a minute.",
                details={"errno": "EDQUOT", "max_owner_bytes": self.most_bytes},
            )

    def measure(self) -> None:
        """Add up the sizes of all files."""
        self.used_bytes = sum(sizes(self.root))

    async def measure_for_ever(self) -> None:
        """Measure again and again, unless nothing depends on it."""
        while self.most_bytes:
            begun = time.monotonic()
            await asyncio.to_thread(self.measure)
            await asyncio.sleep(max(_SECONDS, _PART * (time.monotonic() - begun)))


def sizes(root: Path) -> Iterator[int]:
    """Give the size of each file of an owner's store; others may write and delete meanwhile."""
    for path in root.iterdir():
        if path.name in NOT_OF_LOCAL:
            continue
        for file in (path, *path.rglob("*")) if path.is_dir() else (path,):
            try:
                if file.is_file():
                    yield file.stat().st_size
            except FileNotFoundError:
                # Under way, and done by now.
                continue


@dataclass
class SpoolFile:
    """A file in the spool; a `with` block removes it in the end, if it is not left to a job.

    Parameters
    ----------
    path : Path
    sha256 : str
        Of the bytes, in hex; empty if it was not requested.
    facts : Facts
        Stated in the form of the upload.
    is_left : bool
        Whether a job has it now, and removes it.
    parts : tuple of Part
        Files that are in it one after the other, where many were sent.
    """

    path: Path
    sha256: str = ""
    facts: mesh.Facts = mesh.NO_FACTS
    is_left: bool = False
    parts: tuple[Part, ...] = ()

    def make_durable(self) -> None:
        """Make the bytes survive a crash: before they are acknowledged without being read."""
        try:
            with self.path.open("rb+") as file:
                os.fsync(file.fileno())
            sync_paths([self.path.parent])
        except OSError as error:
            raise cannot_write(self.path, error) from error

    def remove(self) -> None:
        """Remove the file; one that cannot be removed now goes at the next start."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if not self.is_left:
            self.remove()


def remove_with_beside(path: Path) -> None:
    """Remove a file, and those beside it whose names begin with its own, as `SpoolFile.remove`."""
    # Not by a pattern: each would be compiled, and kept for the next time that never comes.
    with contextlib.suppress(OSError):
        for file in path.parent.iterdir():
            if file.name.startswith(path.name):
                file.unlink(missing_ok=True)


class Spool:
    """A folder for files that are not results yet.

    Parameters
    ----------
    folder : Path
    reserve_bytes : int
        Nothing is received while less is free on its disk.
    """

    def __init__(self, folder: Path, reserve_bytes: int = 0) -> None:
        self.folder = folder
        self._reserve_bytes = reserve_bytes
        make_folder(folder)

    def new_path(self) -> Path:
        """Give an unused path."""
        return self.folder / secrets.token_hex(16)

    def require_reserve(self) -> None:
        """Check that more is free than what uploads leave to everything else.

        Below it, deletions, results of stored sequences, and the audit log go on; without the log
        nothing is answered.

        Raises
        ------
        StoreError
            If not.
        """
        try:
            if self._reserve_bytes:
                require_room(self.folder, self._reserve_bytes)
        except errors.StoreError as error:
            if error.details.get("errno") == "ENOSPC":
                error.message += f" Uploads leave {self._reserve_bytes} bytes free."
                error.details["reserve_bytes"] = self._reserve_bytes
            raise

    def at(self, name: str) -> Path:
        """Give the path of a file by its name, as jobs remember it."""
        return self.folder / Path(name).name

    async def receive(self, chunks: AsyncIterator[bytes], *, hashed: bool = True) -> SpoolFile:
        """Write what comes in to a file; nothing stays behind if it fails.

        Parameters
        ----------
        chunks : async iterator of bytes
        hashed : bool
            Whether its sha256 is wanted, which takes as long as writing.

        Raises
        ------
        StoreError
            If it cannot be written, or the disk has no more than its reserve.
        """
        self.require_reserve()
        path = self.new_path()
        digest = hashlib.sha256()
        try:
            # Pieces of some 64 KiB go to the page cache: no thread is worth its switch.
            with path.open("xb", buffering=0) as file:
                async for chunk in chunks:
                    if hashed:
                        digest.update(chunk)
                    view = memoryview(chunk)
                    while view:
                        view = view[file.write(view) :]
        except OSError as error:
            SpoolFile(path).remove()
            raise cannot_write(path, error) from error
        except BaseException:
            SpoolFile(path).remove()
            raise
        return SpoolFile(path, digest.hexdigest() if hashed else "")

    def remove(self, name: str) -> None:
        """Remove a file by its name; it may be missing.

        Raises
        ------
        StoreError
            If it cannot be removed.
        """
        remove_durably(self.at(name))

    def clear(self, keep: set[str], before: float = math.inf) -> None:
        """Remove what an ended process left, but for files that jobs still need, or newer ones."""
        for path in self.folder.iterdir():
            with contextlib.suppress(FileNotFoundError):
                if path.name.split(".")[0] not in keep and path.stat().st_mtime < before:
                    path.unlink()
