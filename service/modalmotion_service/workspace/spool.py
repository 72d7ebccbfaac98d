"""Uploads and half-made results on their way, as files of the store's own disk."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from modalmotion.mesh import NO_FACTS, Facts
from modalmotion.store.disk import (
    cannot_write,
    make_folder,
    remove_durably,
    sync_folder,
)
from modalmotion_service.work.upload import Part
from modalmotion_service.workspace.disk import require_reserve


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
    names : dict of str to str
        Subject and label that the form states.
    is_left : bool
        Whether a job has it now, and removes it.
    parts : tuple of Part
        Files that are in it one after the other, where many were sent.
    """

    path: Path
    sha256: str = ""
    facts: Facts = NO_FACTS
    names: dict[str, str] = field(default_factory=dict)
    is_left: bool = False
    parts: tuple[Part, ...] = ()

    def make_durable(self) -> None:
        """Make the bytes survive a crash: before they are acknowledged without being read."""
        try:
            with self.path.open("rb+") as file:
                os.fsync(file.fileno())
            sync_folder(self.path.parent)
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
        """Raise StoreError if the disk has no more than its reserve."""
        require_reserve(self.folder, self._reserve_bytes)

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

    def clear(self, keep: set[str]) -> None:
        """Remove what an ended process left, but for files that jobs still need."""
        for path in self.folder.iterdir():
            if path.name.split(".")[0] not in keep:
                path.unlink(missing_ok=True)
