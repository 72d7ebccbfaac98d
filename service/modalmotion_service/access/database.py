"""SQLite files beside the stores: keys and audit, used by server and command line at once."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from modalmotion.errors import CorruptFileError, StoreError
from modalmotion.store.disk.atomic import sync_folder


def open_database(path: Path, tables: Sequence[str], version: int) -> sqlite3.Connection:
    """Open a SQLite file that only its owner may read, made with its tables where it is missing.

    Parameters
    ----------
    path : Path
    tables : sequence of str
        Statements that make them.
    version : int
        Of the tables.

    Raises
    ------
    CorruptFileError
        If it is damaged.
    StoreError
        If it was written by another version, or cannot be opened.
    """
    with explained(path.name):
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            # SQLite gives its log and its shared memory the rights of the file itself.
            is_new = not path.exists()
            os.close(os.open(path, os.O_CREAT | os.O_RDWR, 0o600))
            if is_new:
                sync_folder(path.parent)
                sync_folder(path.parent.parent)
            # Restored from a backup they may have others.
            with suppress(PermissionError):
                path.parent.chmod(0o700)
                path.chmod(0o600)
        except OSError as error:
            raise StoreError(
                f"{path.name} cannot be opened: {error.strerror}.",
                remedy="Check the data folder, and that this user may write to it.",
            ) from error
        connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        try:
            _prepare(connection, path.name, tables, version)
        except BaseException:
            connection.close()
            raise
    return connection


def _prepare(
    connection: sqlite3.Connection, name: str, tables: Sequence[str], version: int
) -> None:
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("BEGIN IMMEDIATE")
    (current,) = connection.execute("PRAGMA user_version").fetchone()
    if current == 0:
        for statement in tables:
            connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {version}")
    connection.execute("COMMIT")
    if current not in (0, version):
        raise StoreError(
            f"{name} has version {current} of its tables; this program knows {version}.",
            remedy="Use the modalmotion that wrote it, or a newer one.",
        )


@contextmanager
def explained(name: str) -> Iterator[None]:
    """Raise what SQLite says of a file as an error of ours."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise StoreError(
            f"{name} could not be read or written ({error}).",
            remedy="Check that the disk is not full and may be written to, and try again.",
        ) from error
    except sqlite3.DatabaseError as error:
        raise CorruptFileError(
            f"{name} is damaged ({error}).", remedy="Restore it from a backup."
        ) from error
