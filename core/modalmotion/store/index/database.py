"""The SQLite file of a store: its tables, those of its guests, and who may use it when."""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modalmotion.errors import CorruptFileError, StoreError
from modalmotion.store.index.schema import OWN_TABLES, TABLES, VERSION

# For the upper pages of every tree among a million sequences, so that a look-up reads only its last
# ones from the file. SQLite's own 2 MB are those of ten thousand.
_READ_CACHE_KB = 8_000

_REBUILD = "Run `modalmotion store rebuild FOLDER`."


@dataclass(frozen=True)
class GuestTable:
    """A table of the file that is not the store's own.

    Parameters
    ----------
    name : str
    statement : str
        That makes it.
    rows : list of tuple
    """

    name: str
    statement: str
    rows: list[tuple[Any, ...]]


class Database:
    """Two connections for any number of threads: one that writes, one that reads.

    SQLite has one writer at a time anyway, so a lock costs it nothing. A second connection
    lets readers go on while a commit waits for the disk, and sees what was committed before.
    One connection for each thread would gain little, for statements take microseconds, and
    leave connections behind with every thread that ends.

    Parameters
    ----------
    path : Path
        Made, with its tables, where it is missing or empty.

    Raises
    ------
    CorruptFileError
        If it is damaged or not an index.
    StoreError
        If it was written by a newer version, or cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._write_lock = threading.Lock()
        self._read_lock = threading.Lock()
        with _explained():
            self._writer = _connect(path)
            try:
                self._prepare()
                self._reader = _connect(path)
                self._reader.execute("PRAGMA query_only = ON")
                self._reader.execute(f"PRAGMA cache_size = -{_READ_CACHE_KB}")
            except BaseException:
                self._writer.close()
                raise

    def read(self, statement: str, values: Sequence[Any] = ()) -> list[Any]:
        """Rows that a statement finds."""
        with self._read_lock, _explained():
            return self._reader.execute(statement, values).fetchall()

    @contextmanager
    def write(self, *, erases: bool = False) -> Iterator[sqlite3.Connection]:
        """Give a connection inside one transaction, which is durable when the block ends.

        Parameters
        ----------
        erases : bool
            Whether what it removes or replaces is to leave the write-ahead log too. Where another
            process reads at that moment, the next such call does it.

        Raises
        ------
        StoreError
            If SQLite fails; then, and whenever the block raises, nothing is changed.
        """
        with self._write_lock, _explained():
            # One that a failing disk did not let us roll back would keep out all others.
            self._roll_back()
            self._writer.execute("BEGIN IMMEDIATE")
            try:
                yield self._writer
                self._writer.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):
                    self._roll_back()
                raise
            if erases:
                # Done or not, it is committed. Nobody waits for a backup that reads.
                with self._read_lock, contextlib.suppress(sqlite3.OperationalError):
                    self._writer.execute("PRAGMA busy_timeout = 100")
                    self._writer.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
                self._writer.execute("PRAGMA busy_timeout = 5000")

    def _roll_back(self) -> None:
        # SQLite may have rolled back by itself, as it does when the disk is full.
        if self._writer.in_transaction:
            self._writer.execute("ROLLBACK")

    def extend(self, statements: Iterable[str]) -> None:
        """Make tables of another owner in the file, such as a service's jobs.

        They are written to as the store's own, are in every backup of it, and stay when the
        index is built anew.

        Parameters
        ----------
        statements : iterable of str
            `CREATE TABLE IF NOT EXISTS ...`, and the same of indices and triggers.
        """
        with self.write() as connection:
            for statement in statements:
                connection.execute(statement)

    def guests(self) -> list[GuestTable]:
        """Read the tables that `extend` has made, to put them into a new index."""
        names = ", ".join("?" * len(OWN_TABLES))
        tables = self.read(
            "SELECT name, sql FROM sqlite_master "  # noqa: S608 (of constants)
            f"WHERE type = 'table' AND name NOT LIKE 'sqlite_%' AND name NOT IN ({names})",
            OWN_TABLES,
        )
        return [
            GuestTable(name, sql, self.read(f'SELECT * FROM "{name}"'))  # noqa: S608 (own schema)
            for name, sql in tables
        ]

    def receive(self, guests: Iterable[GuestTable]) -> None:
        """Make tables that `guests` has read, with their rows."""
        with self.write() as connection:
            for guest in guests:
                connection.execute(guest.statement)
                for row in guest.rows:
                    places = ", ".join("?" * len(row))
                    statement = f'INSERT INTO "{guest.name}" VALUES ({places})'  # noqa: S608
                    connection.execute(statement, row)

    def close(self) -> None:
        """Close both connections; the write-ahead log is merged into the file."""
        with self._write_lock, self._read_lock, _explained():
            self._reader.close()
            self._writer.close()

    def faults(self) -> list[str]:
        """List what SQLite itself finds wrong with the file."""
        with self._write_lock:
            try:
                rows = self._writer.execute("PRAGMA integrity_check(20)").fetchall()
            except sqlite3.DatabaseError as error:
                return [str(error)]
        return [text for (text,) in rows if text != "ok"]

    def _prepare(self) -> None:
        self._writer.execute("PRAGMA journal_mode = WAL")
        (version,) = self._writer.execute("PRAGMA user_version").fetchone()
        if version == VERSION:
            return
        (n_tables,) = self._writer.execute("SELECT count(*) FROM sqlite_master").fetchone()
        if version != 0 or n_tables:
            raise StoreError(
                f"The index has version {version} of its schema; this program knows {VERSION}.",
                remedy="Use the modalmotion that wrote it. Without it: "
                "remove index.sqlite, which loses jobs only, and open the store.",
                details={"schema_version": version, "known": VERSION},
            )
        self._writer.execute("BEGIN IMMEDIATE")
        for statement in TABLES:
            self._writer.execute(statement)
        self._writer.execute(f"PRAGMA user_version = {VERSION}")
        self._writer.execute("COMMIT")


def _connect(path: Path) -> sqlite3.Connection:
    # Transactions are begun by hand; the locks of `Database` keep threads apart.
    connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA foreign_keys = ON")
        # What is deleted is overwritten: free pages would keep names of patients.
        connection.execute("PRAGMA secure_delete = ON")
    except BaseException:
        connection.close()
        raise
    return connection


@contextmanager
def _explained() -> Iterator[None]:
    try:
        yield
    except sqlite3.ProgrammingError as error:
        raise StoreError("The store is closed.", remedy="Open it first.") from error
    except sqlite3.OperationalError as error:
        raise StoreError(
            f"The index could not be read or written ({error}); nothing was changed.",
            remedy="Check that the disk is not full and may be written to, and try again.",
        ) from error
    except sqlite3.DatabaseError as error:
        raise CorruptFileError(f"The index is damaged ({error}).", remedy=_REBUILD) from error
