"""Group commit: a few fsync waits for many files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from modalmotion.store.disk.atomic import cannot_write, temporary_beside

# A journal commits what several threads wait for in one go. More than these gain little.
_N_WAITING: Final = 4


class GroupCommit:
    """Files that are written one by one, and are there together: wholly, or none of them.

    At the end of its block all of them are synchronised and then renamed; after an exception
    none is left. Their names are not durable yet, for the caller moves them on.
    """

    def __init__(self) -> None:
        self._written: list[tuple[Path, Path]] = []

    def write(self, path: Path, data: bytes) -> None:
        """Write a file beside its place.

        Raises
        ------
        StoreError
            If it cannot be written.
        """
        temporary = temporary_beside(path)
        try:
            temporary.write_bytes(data)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            raise cannot_write(path, error) from error
        self._written.append((temporary, path))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                self._finish()
        finally:
            for temporary, _ in self._written:
                temporary.unlink(missing_ok=True)

    def _finish(self) -> None:
        try:
            sync_paths(temporary for temporary, _ in self._written)
            for temporary, path in self._written:
                temporary.replace(path)
        except OSError as error:
            raise cannot_write(self._written[0][1], error) from error


def move_files(moves: Sequence[tuple[Path, Path]]) -> None:
    """Rename durable files, each to its path, and make their new names durable; may raise OSError.

    A file that was moved before something failed stays where it is then.
    """
    for source, target in moves:
        source.replace(target)
    sync_paths(target.parent for _, target in moves)


def sync_paths(paths: Iterable[Path]) -> None:
    """Make files, or the names in folders, durable; may raise OSError."""
    different = list(dict.fromkeys(paths))
    if len(different) <= _N_WAITING:
        for path in different:
            _sync(path)
        return
    with ThreadPoolExecutor(_N_WAITING) as pool:
        list(pool.map(_sync, different))


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
