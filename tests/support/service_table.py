"""A table in the file of a store's index that is not the store's own."""

from __future__ import annotations

from modalmotion.store import ResultStore

STATEMENT = "CREATE TABLE IF NOT EXISTS visits (number INTEGER PRIMARY KEY, name TEXT)"


def visit(store: ResultStore, number: int) -> None:
    """Add a row, durably."""
    store.database.extend([STATEMENT])
    with store.database.write() as connection:
        connection.execute("INSERT INTO visits VALUES (?, ?)", (number, "Zoë"))


def visits(store: ResultStore) -> set[int]:
    """Numbers of all rows."""
    store.database.extend([STATEMENT])
    return {number for (number,) in store.database.read("SELECT number FROM visits")}
