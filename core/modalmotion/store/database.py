"""The SQLite file of a store: its tables, those of a service, and who may use it when.

What is listed or counted is found through an index of its own, in as many steps among a million
rows as among a few. Rows of `sequences` are in the order in which they came, so that those of a
page are neighbours; triggers keep the numbers in `counts`, and say which sequences were tracked.
"""

import contextlib
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, get_args

from modalmotion.errors import CorruptFileError, StoreError
from modalmotion.store.folders import ResultKind

VERSION: Final = 4

OWN_TABLES: Final = ("state", "counts", "sequences", "results", "models")

ServiceTable = tuple[str, str, list[tuple[Any, ...]]]
"""A table of the file that is not the store's own: name, statement that makes it, rows."""

_SEQUENCES: Final = (
    """CREATE TABLE sequences (
        id TEXT PRIMARY KEY NOT NULL, n_frames INTEGER NOT NULL, n_vertices INTEGER NOT NULL,
        n_faces INTEGER NOT NULL, topology TEXT, grid TEXT, unit TEXT,
        has_times INTEGER NOT NULL, subject TEXT, label TEXT, created TEXT NOT NULL,
        has_upload INTEGER NOT NULL, facts TEXT NOT NULL DEFAULT '{}', span REAL,
        is_tracked INTEGER NOT NULL DEFAULT 0, name TEXT
    )""",
    *(
        f"CREATE INDEX {rows}_by_{name} ON sequences ({columns}created, id) {condition}"
        for rows, condition in (("sequences", ""), ("tracks", "WHERE is_tracked = 1"))
        for name, columns in (
            *(("time", ""), ("subject", "subject, "), ("label", "label, ")),
            ("both", "subject, label, "),
        )
    ),
    """CREATE TABLE results (
        kind TEXT NOT NULL, sequence_id TEXT NOT NULL REFERENCES sequences ON DELETE CASCADE,
        model_id TEXT NOT NULL, key TEXT NOT NULL, sha256 TEXT NOT NULL,
        PRIMARY KEY (sequence_id, kind, model_id, key)
    ) WITHOUT ROWID""",
    "CREATE TABLE counts (kind TEXT PRIMARY KEY, number INTEGER NOT NULL) WITHOUT ROWID",
    *(
        f"INSERT INTO counts VALUES ('{kind}', 0)"  # noqa: S608 (of constants)
        for kind in ("sequence", *get_args(ResultKind))
    ),
    """CREATE TRIGGER a_sequence_came AFTER INSERT ON sequences BEGIN
        UPDATE counts SET number = number + 1 WHERE kind = 'sequence'; END""",
    """CREATE TRIGGER a_sequence_went AFTER DELETE ON sequences BEGIN
        UPDATE counts SET number = number - 1 WHERE kind = 'sequence'; END""",
    """CREATE TRIGGER a_result_came AFTER INSERT ON results BEGIN
        UPDATE counts SET number = number + 1 WHERE kind = NEW.kind; END""",
    """CREATE TRIGGER a_result_went AFTER DELETE ON results BEGIN
        UPDATE counts SET number = number - 1 WHERE kind = OLD.kind; END""",
    """CREATE TRIGGER a_track_came AFTER INSERT ON results WHEN NEW.kind = 'track' BEGIN
        UPDATE sequences SET is_tracked = 1 WHERE id = NEW.sequence_id; END""",
    """CREATE TRIGGER a_track_went AFTER DELETE ON results WHEN OLD.kind = 'track' BEGIN
        UPDATE sequences SET is_tracked = 0 WHERE id = OLD.sequence_id; END""",
)

TABLES: Final = (
    """CREATE TABLE state (
        name TEXT PRIMARY KEY, value INTEGER NOT NULL
    ) WITHOUT ROWID""",
    *_SEQUENCES,
    """CREATE TABLE models (
        name TEXT NOT NULL, version INTEGER NOT NULL, id TEXT NOT NULL, classes TEXT NOT NULL,
        parameters TEXT NOT NULL, created TEXT NOT NULL, training TEXT, deleted TEXT,
        PRIMARY KEY (name, version)
    ) WITHOUT ROWID""",
)
"""What makes an empty index."""

# For the upper pages of every tree among a million sequences, so that a look-up reads only its last
# ones from the file. SQLite's own 2 MB are those of ten thousand.
_READ_CACHE_KB = 8_000

_REBUILD: Final = "Run `modalmotion store rebuild FOLDER`."
_LOSE_JOBS: Final = (
    ". If that is not possible, remove index.sqlite (only jobs are lost), and open the store."
)


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
    tables : sequence of str
        Statements that make them.
    version : int
        Of the tables.
    called : str
        How errors begin that are about it.
    remedies : tuple of str and str
        Advice where it is damaged, and where it was written by another version.

    Raises
    ------
    CorruptFileError
        If it is damaged or not an index.
    StoreError
        If it was written by another version, or cannot be opened.
    """

    def __init__(
        self,
        path: Path,
        tables: Sequence[str] = TABLES,
        version: int = VERSION,
        called: str = "The index",
        remedies: tuple[str, str] = (_REBUILD, _LOSE_JOBS),
    ) -> None:
        self._write_lock = threading.Lock()
        self._read_lock = threading.Lock()
        self._explained = partial(explained, called, remedies[0])
        with self._explained():
            self._writer = _connect(path)
            try:
                self._prepare(tables, version, called, remedies[1])
                self._reader = _connect(path)
                self._reader.execute("PRAGMA query_only = ON")
                self._reader.execute(f"PRAGMA cache_size = -{_READ_CACHE_KB}")
            except BaseException:
                self._writer.close()
                raise

    def read(self, statement: str, values: Sequence[Any] = ()) -> list[Any]:
        """Rows that a statement finds."""
        with self._read_lock, self._explained():
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
        with self._write_lock, self._explained():
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

    def service_tables(self) -> list[ServiceTable]:
        """Read the tables that `extend` has made, to put them into a new index."""
        tables = self.read(
            "SELECT name, sql FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%'"
        )
        return [
            (name, sql, self.read(f'SELECT * FROM "{name}"'))  # noqa: S608 (own schema)
            for name, sql in tables
            if name not in OWN_TABLES
        ]

    def receive(self, tables: Iterable[ServiceTable]) -> None:
        """Make tables that `service_tables` has read, with their rows."""
        with self.write() as connection:
            for name, statement, rows in tables:
                connection.execute(statement)
                if rows:
                    places = ", ".join("?" * len(rows[0]))
                    connection.executemany(f'INSERT INTO "{name}" VALUES ({places})', rows)  # noqa: S608

    def close(self) -> None:
        """Close both connections; the write-ahead log is merged into the file."""
        with self._write_lock, self._read_lock, self._explained():
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

    def _prepare(self, tables: Sequence[str], version: int, called: str, remedy: str) -> None:
        self._writer.execute("PRAGMA journal_mode = WAL")
        # Within a transaction: another process may be making the tables.
        self._writer.execute("BEGIN IMMEDIATE")
        (found,) = self._writer.execute("PRAGMA user_version").fetchone()
        (n_tables,) = self._writer.execute("SELECT count(*) FROM sqlite_master").fetchone()
        if found == 0 and not n_tables:
            for statement in tables:
                self._writer.execute(statement)
            self._writer.execute(f"PRAGMA user_version = {version}")
        elif found != version:
            raise StoreError(
                f"{called} has schema version {found}; this program reads version {version}.",
                remedy=f"Use the version of modalmotion that wrote it{remedy}",
                details={"schema_version": found, "known": version},
            )
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
def explained(called: str, remedy: str) -> Iterator[None]:
    """Raise what SQLite says of a file as an error of ours, which begins as `called`."""
    try:
        yield
    except sqlite3.ProgrammingError as error:
        raise StoreError("The store is closed.", remedy="Open it first.") from error
    except sqlite3.OperationalError as error:
        raise StoreError(
            f"{called} could not be read or written ({error}); nothing was changed.",
            remedy="Check that the disk is writable and not full, and try again.",
        ) from error
    except sqlite3.DatabaseError as error:
        raise CorruptFileError(f"{called} is damaged ({error}).", remedy=remedy) from error
