"""The tables of the index: no list, look-up or number reads all rows; an older one is taken."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from store_samples import (
    put_classification,
    sample_classification,
    sample_sequence,
    sample_signature,
)

from modalmotion.errors import StoreError
from modalmotion.store import ResultStore, rebuild, verify
from modalmotion.store.database import VERSION, Database
from modalmotion.store.folders import ResultName, track_name
from modalmotion.store.index import Index, put_results

N = 6
TRACKED = (1, 4)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    with ResultStore(tmp_path / "store") as store:
        for number in range(N):
            sequence = sample_sequence(number)
            store.put_sequence(sequence, subject=f"P {number % 2}", label="rest")
            store.put_signature(sample_signature(sequence))
            if number in TRACKED:
                put_track(store.database, sequence.id)
    return tmp_path / "store"


def put_track(database: Database, sequence_id: str) -> None:
    with database.write() as connection:
        put_results(connection, [(track_name(sequence_id), "0" * 64)])


@pytest.fixture
def database(root: Path) -> Iterator[Database]:
    opened = Database(root / "index.sqlite")
    yield opened
    opened.close()


class Plans:
    """How SQLite goes about each query that is read."""

    def __init__(self, database: Database, patch: pytest.MonkeyPatch) -> None:
        self.steps: list[str] = []
        self._read = database.read
        patch.setattr(database, "read", self.read)

    def read(self, statement: str, values: tuple[Any, ...] = ()) -> list[Any]:
        plan = self._read(f"EXPLAIN QUERY PLAN {statement}", values)
        self.steps += [step for *_, step in plan]
        return self._read(statement, values)

    def take(self) -> list[str]:
        steps, self.steps = self.steps, []
        return steps


def test_no_page_or_look_up_reads_or_sorts_all_rows(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    index, plans = Index(database), Plans(database, monkeypatch)
    some, cursor = sample_sequence(1).id, None
    expected = {"": "time", "subject": "subject", "label": "label", "subject label": "both"}
    for tracked in (False, True):
        for names, by in expected.items():
            subject = "P 1" if "subject" in names else None
            label = "rest" if "label" in names else None
            page = index.page(subject, label, 1, cursor, tracked=tracked)
            cursor = page.cursor
            (step,) = plans.take()
            used = "INDEX tracks" if tracked else "INDEX sequences"
            assert step.startswith(f"SEARCH sequences USING {used}_by_{by} (")
            # The place of the cursor is sought, not counted to.
            assert "(created,id)<(?,?)" in step
    index.find(some)
    index.digest(track_name(some))
    index.results_of(some, "signature")
    steps = plans.take()
    assert len(steps) == 3
    assert all(step.startswith("SEARCH ") for step in steps), steps
    index.count()
    assert plans.take() == ["SCAN counts"]
    # What would: the test can fail.
    index.recount()
    assert any(step.startswith("SCAN sequences") for step in plans.take())


def test_numbers_and_tracks_follow_the_rows(root: Path) -> None:
    with ResultStore(root) as store:
        index = Index(store.database)

        def check(n_sequences: int, n_signatures: int, tracks: list[int]) -> None:
            counted = {
                "sequence": n_sequences,
                "signature": n_signatures,
                "track": len(tracks),
            }
            assert store.count() == index.recount()
            assert store.count() == {
                kind: n for kind, n in counted.items() if n or kind == "sequence"
            }
            listed = [record.id for record in store.list_sequences(tracked=True).records]
            assert listed == [sample_sequence(number).id for number in tracks]

        check(N, N, [4, 1])
        # What is there already is counted once, and keeps its track.
        store.put_sequence(sample_sequence(4))
        store.update_sequence(sample_sequence(4).id, label="stress")
        name = ResultName("signature", sample_sequence(4).id, "", "a" * 16)
        index.change((), {name: "1" * 64})
        index.change((), {name: "2" * 64})
        check(N, N + 1, [4, 1])
        assert [r.label for r in store.list_sequences(tracked=True, label="stress").records] == [
            "stress"
        ]

        def fail() -> None:
            with store.database.write() as connection:
                connection.execute("DELETE FROM sequences")
                raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            fail()
        check(N, N + 1, [4, 1])
        store.delete_sequence(sample_sequence(4).id)
        check(N - 1, N - 1, [1])
        put_classification(store, sample_classification(sample_sequence(1).id), "b" * 16)
        assert store.count()["classification"] == 1
        for number in (0, 1, 2, 3, 5):
            store.delete_sequence(sample_sequence(number).id)
        check(0, 0, [])


def test_numbers_that_are_wrong_are_found_and_counted_anew(root: Path) -> None:
    with contextlib.closing(sqlite3.connect(root / "index.sqlite")) as connection:
        connection.execute("DELETE FROM results WHERE kind = 'track'")
        connection.execute("UPDATE counts SET number = number + 7 WHERE kind = 'sequence'")
        connection.commit()
    assert [fault.problem for fault in verify(root).faults] == [
        "Its row counts are wrong; run `modalmotion store rebuild`."
    ]
    rebuild(root)
    assert verify(root).is_sound
    with ResultStore(root) as store:
        assert store.count() == {"sequence": N, "signature": N}


@pytest.mark.parametrize("version", [1, VERSION + 1])
def test_an_index_of_another_version_is_refused(root: Path, version: int) -> None:
    with contextlib.closing(sqlite3.connect(root / "index.sqlite")) as connection:
        connection.execute(f"PRAGMA user_version = {version}")
    for use in (rebuild, lambda at: ResultStore(at).open()):
        with pytest.raises(StoreError, match=f"version {version}.*reads version {VERSION}"):
            use(root)
