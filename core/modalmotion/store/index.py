"""The index of sequences, results and models, and cursors into its lists."""

import base64
import binascii
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final

from modalmotion import errors, mesh
from modalmotion.classification.card import ModelRecord
from modalmotion.representation import shown
from modalmotion.signature.parameters import parameters_as_json, parameters_from_json
from modalmotion.store.database import Database
from modalmotion.store.folders import ResultKind, ResultName, SequenceRecord, record_values

LARGEST_PAGE: Final = 1000


def now() -> str:
    """Time in UTC as ISO 8601 with microseconds, which sorts as text."""
    return to_text(datetime.now(UTC).timestamp())


def to_text(seconds: float) -> str:
    """Write a time in s since 1970 as `now` does."""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def to_cursor(created: str, row_id: str) -> str:
    """Cursor behind a row."""
    return base64.urlsafe_b64encode(f"{created} {row_id}".encode()).decode().rstrip("=")


def from_cursor(cursor: str | None) -> tuple[str, str]:
    """Time and id of the row that a page ended with; behind every row for the first page.

    Raises
    ------
    ParameterError
        If it does not come from a list.
    """
    if cursor is None:
        return "~", ""
    try:
        padded = cursor.encode("ascii") + b"=" * (-len(cursor) % 4)
        created, row_id = base64.b64decode(padded, altchars=b"-_", validate=True).decode().split()
    except (binascii.Error, ValueError):
        raise errors.ParameterError(
            f"{cursor[:40]!r} is not a cursor.",
            remedy="Use the unchanged cursor of the previous page, or none for the first page.",
        ) from None
    return created, row_id


def require_limit(limit: int) -> int:
    """Check the length of a page.

    Raises
    ------
    ParameterError
        If it is not between 1 and 1000.
    """
    if not 1 <= limit <= LARGEST_PAGE:
        raise errors.ParameterError(
            f"A page of {limit} was requested; a page has 1 to {LARGEST_PAGE}.",
            remedy=f"Request 1 to {LARGEST_PAGE} entries, and further pages with the cursor.",
            details={"limit": limit, "largest": LARGEST_PAGE},
        )
    return limit


_PIECE: Final = 10_000
_OF_SEQUENCE: Final = tuple(field.name for field in fields(SequenceRecord))
_OF_MODEL: Final = tuple(field.name for field in fields(ModelRecord))
_AS_JSON: Final = ("classes", "parameters")
_RECORDS: Final = f"SELECT {', '.join(_OF_SEQUENCE)} FROM sequences"  # noqa: S608 (constants)


@shown()
@dataclass(frozen=True)
class SequencePage:
    """Part of a list of sequences, newest first.

    Parameters
    ----------
    records : tuple of SequenceRecord
    cursor : str or None
        For the page after this one; None on the last.
    """

    records: tuple[SequenceRecord, ...]
    cursor: str | None


class Index:
    """Queries on the tables `sequences`, `results` and `models`.

    Parameters
    ----------
    database : Database
    """

    def __init__(self, database: Database) -> None:
        self.database = database
        # Most sequences of a store state the same few. Of each store by itself: from the time of a
        # list nobody is to learn what another owner's sequences state.
        self._facts = lru_cache(maxsize=64)(lambda text: mesh.facts_from_json(json.loads(text)))

    def find(self, sequence_id: str, *, tracked: bool = False) -> SequenceRecord | None:
        """Record of a sequence, only if it was tracked if so; None if there is none."""
        condition = " AND is_tracked = 1" if tracked else ""
        rows = self.database.read(f"{_RECORDS} WHERE id = ?{condition}", (sequence_id,))
        return self._record(rows[0]) if rows else None

    def find_all(self, ids: Iterable[str]) -> dict[str, SequenceRecord]:
        """Look up those sequences that there are, in one query: their records by their ids."""
        rows = self.database.read(
            f"{_RECORDS} WHERE id IN (SELECT value FROM json_each(?))",  # noqa: S608 (constants)
            (json.dumps(list(ids)),),
        )
        return {record.id: record for record in map(self._record, rows)}

    def ids(self) -> Iterator[str]:
        """Ids of all sequences, sorted; a piece of them is in memory at a time."""
        return (sequence_id for (sequence_id,) in self._all("sequences", "id"))

    def page(
        self,
        subject: str | None,
        label: str | None,
        limit: int,
        cursor: str | None,
        *,
        tracked: bool = False,
    ) -> SequencePage:
        """List records from the newest to the oldest, those behind the cursor.

        Parameters
        ----------
        subject, label : str or None
            Only those with exactly this subject, this label.
        limit : int
        cursor : str or None
        tracked : bool
            Only those that were tracked.

        Raises
        ------
        ParameterError
            If the limit is out of range or the cursor is not one of a list.
        """
        # By value and not by count: what is put meanwhile is newer, is before the cursor,
        # and moves nothing behind it.
        conditions, values = ["(created, id) < (?, ?)"], [*from_cursor(cursor)]
        for column, wanted in (("subject", subject), ("label", label)):
            if wanted is not None:
                conditions.append(f"{column} = ?")
                values.append(wanted)
        if tracked:
            # Written out: only so SQLite sees that the indices of tracks hold them all.
            conditions.append("is_tracked = 1")
        rows = self.database.read(
            f"{_RECORDS} WHERE {' AND '.join(conditions)} ORDER BY created DESC, id DESC LIMIT ?",
            (*values, require_limit(limit) + 1),
        )
        records = tuple(self._record(row) for row in rows[:limit])
        last = to_cursor(records[-1].created, records[-1].id) if len(rows) > limit else None
        return SequencePage(records, last)

    def count(self) -> dict[str, int]:
        """Numbers of sequences, and of results by kind where there are any."""
        return dict(
            self.database.read(
                "SELECT kind, number FROM counts WHERE number > 0 OR kind = 'sequence'"
            )
        )

    def recount(self) -> dict[str, int]:
        """Numbers as `count` gives them, of the rows themselves: in proportion to them."""
        return dict(
            self.database.read(
                "SELECT 'sequence', count(*) FROM sequences "
                "UNION ALL SELECT kind, count(*) FROM results GROUP BY kind"
            )
        )

    def change(
        self,
        records: Iterable[SequenceRecord] = (),
        results: Mapping[ResultName, str] = MappingProxyType({}),
        *,
        without: str | None = None,
        erases: bool = False,
    ) -> None:
        """Write records over those with their ids, and results, in one transaction.

        Parameters
        ----------
        records : iterable of SequenceRecord
        results : mapping of ResultName to str
            sha256 of their files.
        without : str, optional
            Id of a sequence that is removed with its results.
        erases : bool
            Whether nothing of what is written over is left, as of what is removed.
        """
        with self.database.write(erases=erases or without is not None) as connection:
            if without is not None:
                connection.execute("DELETE FROM sequences WHERE id = ?", (without,))
            put_records(connection, records)
            put_results(connection, results.items())

    def digest(self, name: ResultName) -> str | None:
        """sha256 of a result's file, None if there is no such result."""
        rows = self.database.read(
            "SELECT sha256 FROM results "
            "WHERE sequence_id = ? AND kind = ? AND model_id = ? AND key = ?",
            (name.sequence_id, name.kind, name.model_id, name.key),
        )
        return str(rows[0][0]) if rows else None

    def results_of(self, sequence_id: str, kind: ResultKind) -> list[ResultName]:
        """Results of a sequence, by model and key."""
        rows = self.database.read(
            "SELECT kind, sequence_id, model_id, key FROM results "
            "WHERE sequence_id = ? AND kind = ? ORDER BY model_id, key",
            (sequence_id, kind),
        )
        return [ResultName(*row) for row in rows]

    def results(self) -> Iterator[ResultName]:
        """Give all results by sequence, kind, model and key; a piece is in memory at a time."""
        for sequence_id, kind, *name in self._all("results", "sequence_id, kind, model_id, key"):
            yield ResultName(kind, sequence_id, *name)

    def _all(self, table: str, key: str) -> Iterator[tuple[Any, ...]]:
        """Give the keys of all rows, in their order."""
        last: tuple[Any, ...] = ("",) * len(key.split())
        places = ", ".join("?" * len(last))
        statement = (
            f"SELECT {key} FROM {table} WHERE ({key}) > ({places}) "  # noqa: S608 (constants)
            f"ORDER BY {key} LIMIT {_PIECE}"
        )
        while rows := self.database.read(statement, last):
            yield from rows
            last = rows[-1]

    def remove_result(self, name: ResultName) -> None:
        """Remove a result."""
        with self.database.write(erases=True) as connection:
            connection.execute(
                "DELETE FROM results "
                "WHERE kind = ? AND sequence_id = ? AND model_id = ? AND key = ?",
                name,
            )

    @property
    def is_clean(self) -> bool:
        """Whether the process that had the store open last closed it in order."""
        return self.database.read("SELECT value FROM state WHERE name = 'clean'") == [(1,)]

    def set_clean(self, clean: bool) -> None:
        """Note whether the store is closed in order."""
        with self.database.write() as connection:
            connection.execute("INSERT OR REPLACE INTO state VALUES ('clean', ?)", (int(clean),))

    def versions(self, name: str) -> list[ModelRecord]:
        """All versions of a model of that name, deleted ones too, from the first to the newest."""
        return self.models("WHERE name = ? ORDER BY version", name)

    def models(self, condition: str = "ORDER BY name, version", *values: str) -> list[ModelRecord]:
        """Versions of models, deleted ones too; by default all of them."""
        rows = self.database.read(
            f"SELECT {', '.join(_OF_MODEL)} FROM models {condition}",  # noqa: S608 (constants)
            values,
        )
        found = (dict(zip(_OF_MODEL, row, strict=True)) for row in rows)
        return [model_from(one | {k: json.loads(one[k]) for k in _AS_JSON}) for one in found]

    def put_model(self, record: ModelRecord) -> None:
        """Add a version of a model, or write it over the one of its number."""
        with self.database.write() as connection:
            put_models(connection, [record])

    def _record(self, row: tuple[Any, ...]) -> SequenceRecord:
        values = list(row)
        values[5] = None if row[5] is None else tuple(json.loads(row[5]))
        values[7], values[11], values[12] = bool(row[7]), bool(row[11]), self._facts(row[12])
        return SequenceRecord(*values)


def put_records(connection: sqlite3.Connection, records: Iterable[SequenceRecord]) -> None:
    """Write records inside a transaction."""
    names, places = ", ".join(_OF_SEQUENCE), ", ".join("?" * len(_OF_SEQUENCE))
    changed = ", ".join(f"{name} = excluded.{name}" for name in _OF_SEQUENCE[1:])
    # An upsert: INSERT OR REPLACE would delete the row first, and its results with it.
    connection.executemany(
        f"INSERT INTO sequences ({names}) VALUES ({places}) "  # noqa: S608 (constants)
        f"ON CONFLICT (id) DO UPDATE SET {changed}",
        (_row(record) for record in records),
    )


def put_results(connection: sqlite3.Connection, results: Iterable[tuple[ResultName, str]]) -> None:
    """Write results inside a transaction."""
    # An upsert here too: what INSERT OR REPLACE takes out is taken off no count.
    connection.executemany(
        "INSERT INTO results (kind, sequence_id, model_id, key, sha256) "
        "VALUES (?, ?, ?, ?, ?) "
        "ON CONFLICT (sequence_id, kind, model_id, key) DO UPDATE SET sha256 = excluded.sha256",
        ((*name, digest) for name, digest in results),
    )


def _row(record: SequenceRecord) -> tuple[Any, ...]:
    values = record_values(record)
    values["grid"] = None if record.grid is None else json.dumps(record.grid)
    values["facts"] = json.dumps(values["facts"])
    return tuple(values.values())


def model_values(record: ModelRecord) -> dict[str, Any]:
    """Values of a version of a model by name, as JSON has them."""
    values = {name: getattr(record, name) for name in _OF_MODEL}
    parameters = parameters_as_json(record.parameters)
    return {**values, "classes": list(record.classes), "parameters": parameters}


def model_from(values: Mapping[str, Any]) -> ModelRecord:
    """Make a record of `model_values`."""
    parameters = parameters_from_json(values["parameters"])
    return ModelRecord(**{**values, "classes": tuple(values["classes"]), "parameters": parameters})


def put_models(connection: sqlite3.Connection, records: Iterable[ModelRecord]) -> None:
    """Write models inside a transaction."""
    rows = (model_values(record) for record in records)
    names, places = ", ".join(_OF_MODEL), ", ".join(f":{name}" for name in _OF_MODEL)
    connection.executemany(
        f"INSERT OR REPLACE INTO models ({names}) VALUES ({places})",  # noqa: S608 (constants)
        (row | {name: json.dumps(row[name]) for name in _AS_JSON} for row in rows),
    )
