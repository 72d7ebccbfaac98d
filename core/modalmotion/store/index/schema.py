"""The tables of the index.

What is listed or counted is found through an index of its own, in as many steps among a million
rows as among a few. Rows of `sequences` lie in the order in which they came, so that those of a
page are neighbours; triggers keep the numbers in `counts`, and say which sequences were tracked.
"""

from __future__ import annotations

import sqlite3
from typing import Final, get_args

from modalmotion.store.folder import ResultKind

VERSION: Final = 4

OWN_TABLES: Final = ("state", "counts", "sequences", "results", "models")

_OTHERS: Final = (
    "n_frames, n_vertices, n_faces, topology, grid, unit, has_times, has_upload, facts, span, "
    "is_tracked, name"
)

_SEQUENCES: Final = (
    """CREATE TABLE sequences (
        id TEXT PRIMARY KEY NOT NULL, n_frames INTEGER NOT NULL, n_vertices INTEGER NOT NULL,
        n_faces INTEGER NOT NULL, topology TEXT, grid TEXT, unit TEXT,
        has_times INTEGER NOT NULL, subject TEXT, label TEXT, created TEXT NOT NULL,
        has_upload INTEGER NOT NULL, facts TEXT NOT NULL DEFAULT '{}', span REAL,
        is_tracked INTEGER NOT NULL DEFAULT 0, name TEXT
    )""",
    "CREATE INDEX sequences_by_time ON sequences (created, id)",
    "CREATE INDEX sequences_by_subject ON sequences (subject, created, id)",
    "CREATE INDEX sequences_by_label ON sequences (label, created, id)",
    "CREATE INDEX sequences_by_both ON sequences (subject, label, created, id)",
    # Tracks may be few and far between: these hold whole records, so that a page is in one place.
    *(
        f"CREATE INDEX tracks_by_{name} ON sequences ({columns}) WHERE is_tracked = 1"
        for name, columns in (
            ("time", f"created, id, subject, label, {_OTHERS}"),
            ("subject", f"subject, created, id, label, {_OTHERS}"),
            ("label", f"label, created, id, subject, {_OTHERS}"),
            ("both", f"subject, label, created, id, {_OTHERS}"),
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

SEQUENCE_COLUMNS: Final = (
    "id, n_frames, n_vertices, n_faces, topology, grid, unit, has_times, subject, label, created, "
    "has_upload, facts, span, name"
)
"""Of a record, in its order."""


def recount(connection: sqlite3.Connection) -> None:
    """Count all rows anew, inside a transaction: a damaged index may have miscounted them."""
    connection.execute(
        "UPDATE counts SET number = CASE kind "
        "WHEN 'sequence' THEN (SELECT count(*) FROM sequences) "
        "ELSE (SELECT count(*) FROM results WHERE results.kind = counts.kind) END"
    )
