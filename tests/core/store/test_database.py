"""The file of the index: transactions, durability, what is no index, and tables of a service."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest
from service_table import STATEMENT

from modalmotion.errors import CorruptFileError, StoreError
from modalmotion.store import ResultStore
from modalmotion.store.database import VERSION, Database


def test_a_failing_block_changes_nothing(tmp_path: Path) -> None:
    database = Database(tmp_path / "index.sqlite")

    def write(statement: str, number: int) -> None:
        with database.write() as connection:
            connection.execute("INSERT INTO state VALUES ('a', 1)")
            connection.execute(statement, (1 // number,))

    with pytest.raises(ZeroDivisionError):
        write("INSERT INTO state VALUES ('b', ?)", 0)
    assert database.read("SELECT * FROM state") == []
    with pytest.raises(StoreError, match="no such table"):
        write("INSERT INTO no_such_table VALUES (?)", 1)
    assert database.read("SELECT * FROM state") == []
    with database.write() as connection:
        connection.execute("INSERT INTO state VALUES ('a', 1)")
    assert database.read("SELECT * FROM state") == [("a", 1)]
    database.close()
    with pytest.raises(StoreError, match="closed"):
        database.read("SELECT * FROM state")


def test_a_transaction_that_could_not_be_rolled_back_keeps_nobody_out(tmp_path: Path) -> None:
    database = Database(tmp_path / "index.sqlite")
    # What a disk leaves that fails in the middle of a commit, and of its undoing.
    database._writer.execute("BEGIN IMMEDIATE")
    database._writer.execute("INSERT INTO state VALUES ('half', 1)")
    with database.write() as connection:
        connection.execute("INSERT INTO state VALUES ('whole', 1)")
    assert database.read("SELECT name FROM state") == [("whole",)]
    database.close()


def test_commits_wait_for_the_disk(tmp_path: Path) -> None:
    database = Database(tmp_path / "index.sqlite")
    for connection in (database._writer, database._reader):
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert connection.execute("PRAGMA synchronous").fetchone() == (2,)
        assert connection.execute("PRAGMA foreign_keys").fetchone() == (1,)
    database.close()


@pytest.mark.parametrize(
    "content", [b"no database at all" * 100, b"SQLite format 3\x00" + b"x" * 5000]
)
def test_an_index_that_is_none_asks_for_a_rebuild(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "index.sqlite").write_bytes(content)
    with pytest.raises(CorruptFileError) as caught:
        ResultStore(tmp_path).open()
    assert "modalmotion store rebuild" in caught.value.remedy
    # The lock was given back.
    with pytest.raises(CorruptFileError):
        ResultStore(tmp_path).open()


@pytest.mark.parametrize("version", [VERSION - 1, VERSION + 1, 99])
def test_an_index_of_another_version_is_not_touched(version: int, tmp_path: Path) -> None:
    ResultStore(tmp_path).open().close()
    connection = sqlite3.connect(tmp_path / "index.sqlite")
    connection.execute(f"PRAGMA user_version = {version}")
    connection.close()
    before = (tmp_path / "index.sqlite").read_bytes()
    with pytest.raises(StoreError, match=f"version {version}"):
        ResultStore(tmp_path).open()
    assert (tmp_path / "index.sqlite").read_bytes() == before


def test_a_foreign_sqlite_file_is_not_taken_for_an_index(tmp_path: Path) -> None:
    connection = sqlite3.connect(tmp_path / "index.sqlite")
    connection.execute("CREATE TABLE mine (a)")
    connection.close()
    with pytest.raises(StoreError, match="version 0"):
        ResultStore(tmp_path).open()


def test_service_tables_are_read_and_put_into_another_index_with_every_value(
    tmp_path: Path,
) -> None:
    here, there = Database(tmp_path / "a.sqlite"), Database(tmp_path / "b.sqlite")
    assert here.service_tables() == []
    rows = [(1, "Zoë"), (2, None), (3, "'; DROP TABLE visits--")]
    here.extend([STATEMENT, "CREATE INDEX IF NOT EXISTS by_name ON visits (name)"])
    with here.write() as connection:
        connection.executemany("INSERT INTO visits VALUES (?, ?)", rows)
    here.extend([STATEMENT])
    (table,) = here.service_tables()
    assert (table[0], table[2]) == ("visits", rows)
    there.receive([table])
    assert there.service_tables() == [table]
    there.extend([STATEMENT.replace("visits", "empty")])
    here.receive([table for table in there.service_tables() if table[0] == "empty"])
    assert [name for name, _, _ in here.service_tables()] == ["visits", "empty"]
    for database in (here, there):
        assert database.faults() == []
        database.close()
