"""Indices of any size, without files: rows as a store and a service would have written them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from modalmotion.store import ResultStore, SequenceRecord
from modalmotion.store.folder import ResultName, track_name
from modalmotion.store.index.cursor import to_text
from modalmotion.store.index.database import Database
from modalmotion.store.index.index import Index, put_records, put_results
from modalmotion_service.workspace.jobs import Jobs

KEY: Final = "0123456789abcdef"
N_OF_SUBJECT: Final = 25
LABELS: Final = ("normal", "akinesia", "dyskinesia", "torsion")
KINDS: Final = ("upload", "signature", "training")

_PIECE: Final = 20_000
# Of 2026-01-01, and one sequence a second from then on.
_START: Final = 1_767_225_600
_TRACKED: Final = 200


@dataclass(frozen=True)
class Rows:
    """What lies in an index of n sequences.

    Parameters
    ----------
    root : Path
        Folder of its store.
    n : int
    """

    root: Path
    n: int

    def sequence(self, number: int) -> str:
        """Id of a sequence, counted from the oldest."""
        return hashlib.sha256(f"{self.n} sequence {number}".encode()).hexdigest()

    def job(self, number: int) -> str:
        """Id of a job, counted from the oldest."""
        return hashlib.sha256(f"{self.n} job {number}".encode()).hexdigest()[:32]

    def subject(self, number: int) -> str:
        """Whose it is: a subject's sequences came over all the time."""
        return f"P {number % (self.n // N_OF_SUBJECT)}"

    def label(self, number: int) -> str:
        """Give what it shows: each subject has some of each."""
        return LABELS[(number + number // (self.n // N_OF_SUBJECT)) % len(LABELS)]

    def created(self, number: int) -> str:
        """When a sequence, or a job, came."""
        return to_text(_START + number)

    def sample(self, n: int = 1000) -> list[int]:
        """Numbers from all over the index, in no order."""
        step = max(1, self.n // n)
        numbers = range(step // 2, self.n, step)
        return sorted(numbers, key=self.sequence)


def fill(root: Path, n: int) -> Rows:
    """Make the index of a store of n sequences, each with a signature, and of n jobs.

    A quarter has a classification too, one in 200 was tracked. There are no files.
    """
    rows = Rows(root, n)
    ResultStore(root).open().close()
    database = Database(root / "index.sqlite")
    Jobs(database)
    numbers = iter(range(0, n, _PIECE))
    for first in numbers:
        piece = range(first, min(n, first + _PIECE))
        with database.write() as connection:
            # Ids are random: without room for their index each row would be read from the disk.
            connection.execute("PRAGMA cache_size = -600000")
            put_records(connection, (_record(rows, number) for number in piece))
            put_results(connection, _results(rows, piece))
            connection.executemany(
                "INSERT INTO jobs VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", _jobs(rows, piece)
            )
    Index(database).set_clean(True)
    database.close()
    return rows


def _record(rows: Rows, number: int) -> SequenceRecord:
    return SequenceRecord(
        id=rows.sequence(number),
        n_frames=25,
        n_vertices=4000,
        n_faces=7996,
        topology="cup",
        grid=None,
        unit="mm",
        has_times=True,
        subject=rows.subject(number),
        label=rows.label(number),
        created=rows.created(number),
        has_upload=True,
        span=0.96,
    )


def _results(rows: Rows, piece: range) -> Iterator[tuple[ResultName, str]]:
    model = hashlib.sha256(b"model").hexdigest()
    for number in piece:
        sequence = rows.sequence(number)
        digest = hashlib.sha256(sequence.encode()).hexdigest()
        yield ResultName("signature", sequence, "", KEY), digest
        if number % 4 == 0:
            yield ResultName("classification", sequence, model, KEY), digest
        if number % _TRACKED == 0:
            yield track_name(sequence), digest


def _jobs(rows: Rows, piece: range) -> Iterator[tuple[object, ...]]:
    for number in piece:
        time, sequence = rows.created(number), rows.sequence(number)
        state = "failed" if number % 50 == 0 else "succeeded"
        request = json.dumps({"sequence_id": sequence, "query": {"modes": 21}})
        result = json.dumps({"link": f"/v1/sequences/{sequence}"})
        yield (
            *(rows.job(number), KINDS[number % len(KINDS)], state, 1.0, request, result, None),
            *(time, time),
        )
