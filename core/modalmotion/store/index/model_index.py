"""The index of models: their versions, present and deleted."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable
from typing import Any, Final

from modalmotion.choice.parameters import parameters_as_json, parameters_from_json
from modalmotion.classification.record import ModelRecord
from modalmotion.store.index.database import Database

_COLUMNS: Final = "name, version, id, classes, parameters, created, training, deleted"


class ModelIndex:
    """Queries on the table `models`.

    Parameters
    ----------
    database : Database
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def versions(self, name: str) -> list[ModelRecord]:
        """All versions of that name, deleted ones too, from the first to the newest."""
        return self._find("WHERE name = ? ORDER BY version", (name,))

    def with_id(self, model_id: str) -> list[ModelRecord]:
        """All versions that are the model of that id, deleted ones too."""
        return self._find("WHERE id = ? ORDER BY name, version", (model_id,))

    def of_training(self, training: str) -> ModelRecord | None:
        """Find the version that a training has made."""
        rows = self._find("WHERE training = ?", (training,))
        return rows[0] if rows else None

    def all(self) -> list[ModelRecord]:
        """All versions of all models, deleted ones too."""
        return self._find("ORDER BY name, version", ())

    def put(self, record: ModelRecord) -> None:
        """Add a version, or write it over the one of its number."""
        with self._database.write() as connection:
            put_models(connection, [record])

    def _find(self, condition: str, values: tuple[Any, ...]) -> list[ModelRecord]:
        rows = self._database.read(
            f"SELECT {_COLUMNS} FROM models {condition}",  # noqa: S608 (constants)
            values,
        )
        return [
            ModelRecord(
                name=row[0],
                version=row[1],
                id=row[2],
                classes=tuple(json.loads(row[3])),
                parameters=parameters_from_json(json.loads(row[4])),
                created=row[5],
                training=row[6],
                deleted=row[7],
            )
            for row in rows
        ]


def put_models(connection: sqlite3.Connection, records: Iterable[ModelRecord]) -> None:
    """Write models inside a transaction."""
    connection.executemany(
        f"INSERT OR REPLACE INTO models ({_COLUMNS}) "  # noqa: S608 (constants)
        "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
        (
            (
                record.name,
                record.version,
                record.id,
                json.dumps(record.classes),
                json.dumps(parameters_as_json(record.parameters)),
                record.created,
                record.training,
                record.deleted,
            )
            for record in records
        ),
    )
