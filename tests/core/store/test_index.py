"""Lists of sequences, page by page, and the names that they are found by."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from store_samples import all_pages, sample_sequence

from modalmotion.errors import ParameterError
from modalmotion.store import UNSET, ResultStore, verify


@pytest.fixture
def store(tmp_path: Path) -> Iterator[ResultStore]:
    with ResultStore(tmp_path / "store") as opened:
        yield opened
    assert verify(tmp_path / "store").is_sound


def test_subject_and_label_are_changed_one_by_one(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence, subject="a", label="b")
    assert store.update_sequence(sequence.id).label == "b"
    assert store.update_sequence(sequence.id, subject=UNSET, label="c").subject == "a"
    record = store.update_sequence(sequence.id, subject=None)
    assert (record.subject, record.label) == (None, "c")
    assert store.sequence_record(sequence.id) == record
    assert store.list_sequences(label="c").records == (record,)


@pytest.mark.parametrize("text", ["x" * 201, "a\nb", "a\x00b", "\ud800"])
def test_a_name_that_cannot_be_kept_is_refused(text: str, store: ResultStore) -> None:
    sequence = sample_sequence(1)
    with pytest.raises(ParameterError, match="subject"):
        store.put_sequence(sequence, subject=text)
    assert not store.has_sequence(sequence.id)
    store.put_sequence(sequence)
    with pytest.raises(ParameterError, match="label"):
        store.update_sequence(sequence.id, label=text)


@pytest.mark.parametrize(
    "text", ["", " ", "Zoë", "山田\u3000太郎", "a'; DROP TABLE sequences--", "%"]
)
def test_any_other_name_is_kept_and_found(text: str, store: ResultStore) -> None:
    sequence, other = sample_sequence(1), sample_sequence(2)
    store.put_sequence(sequence, subject=text)
    store.put_sequence(other, subject="other")
    found = store.list_sequences(subject=text).records
    assert [(record.id, record.subject) for record in found] == [(sequence.id, text)]


@pytest.mark.parametrize("limit", [1, 2, 3, 11, 12, 13])
def test_pages_hold_every_sequence_once_newest_first(limit: int, store: ResultStore) -> None:
    expected: list[tuple[str, int]] = []
    for number in range(12):
        sequence = sample_sequence(number)
        store.put_sequence(sequence, subject=f"s{number % 2}", label=f"l{number % 3}")
        expected.insert(0, (sequence.id, number))
    assert all_pages(store, limit) == [name for name, _ in expected]
    for subject in (None, 0, 1):
        for label in (None, 0, 1, 2):
            wanted = [
                name
                for name, number in expected
                if subject in (None, number % 2) and label in (None, number % 3)
            ]
            filters = {}
            if subject is not None:
                filters["subject"] = f"s{subject}"
            if label is not None:
                filters["label"] = f"l{label}"
            assert all_pages(store, limit, **filters) == wanted


def test_a_cursor_stays_where_it_is_while_others_put_and_delete(store: ResultStore) -> None:
    old = [sample_sequence(number).id for number in range(9)]
    for number in range(9):
        store.put_sequence(sample_sequence(number))
    seen: list[str] = []
    cursor = None
    for step in range(100, 200):
        page = store.list_sequences(limit=2, cursor=cursor)
        seen += [record.id for record in page.records]
        cursor = page.cursor
        if cursor is None:
            break
        store.put_sequence(sample_sequence(step))
        # What is deleted on either side of the cursor shifts nothing.
        store.delete_sequence(seen[0] if step % 2 else old.pop(0))
        if step % 2:
            old.remove(seen.pop(0))
    assert [name for name in seen if name in old] == old[::-1]
    assert len(set(seen)) == len(seen)


def test_sequences_of_the_same_moment_are_all_listed(
    store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("modalmotion.store.sequences.now", lambda: "2026-01-01T00:00:00.000000Z")
    ids = {sample_sequence(number).id for number in range(7)}
    for number in range(7):
        store.put_sequence(sample_sequence(number))
    assert all_pages(store, 2) == sorted(ids, reverse=True)


@pytest.mark.parametrize("cursor", ["", "x", "not base64!", "YQ", "Ñ", "YWJj" * 1000])
def test_a_cursor_that_no_list_gave_is_refused(cursor: str, store: ResultStore) -> None:
    with pytest.raises(ParameterError, match="cursor"):
        store.list_sequences(cursor=cursor)


@pytest.mark.parametrize("limit", [0, -1, 1001])
def test_the_length_of_a_page_is_limited(limit: int, store: ResultStore) -> None:
    with pytest.raises(ParameterError, match="1 to 1000"):
        store.list_sequences(limit=limit)
