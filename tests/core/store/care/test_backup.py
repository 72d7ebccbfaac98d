"""A backup of a store in use holds everything that was acknowledged."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import threading
from pathlib import Path

import numpy as np
import pytest
from guest_table import visit, visits

from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.making import modal_signature
from modalmotion.store import ResultStore, backup, rebuild, verify


def a_sequence(seed: int) -> MeshSequence:
    vertices = np.random.default_rng(seed).normal(size=(3, 64, 3))
    return mesh_sequence(vertices, grid=(8, 8), topology="cup", unit="mm")


def put(store: ResultStore, seed: int) -> str:
    sequence = a_sequence(seed)
    store.put_sequence(sequence, subject=f"P {seed}")
    store.put_signature(modal_signature(sequence))
    return sequence.id


def test_what_was_kept_before_a_backup_is_in_it_whatever_is_written_meanwhile(
    tmp_path: Path,
) -> None:
    root, copy = tmp_path / "store", tmp_path / "copies" / "one"
    with ResultStore(root) as store:
        before = [put(store, seed) for seed in range(10)]
        visit(store, 7)
        (root / "spool").mkdir()
        (root / "spool" / "x").write_text("acknowledged")
        stop = threading.Event()

        def write() -> None:
            seed = 100
            while not stop.is_set():
                sequence_id = put(store, seed)
                if seed % 3 == 0:
                    store.delete_sequence(sequence_id)
                seed += 1

        writer = threading.Thread(target=write)
        writer.start()
        try:
            for _ in range(5):
                report = backup(root, copy)
        finally:
            stop.set()
            writer.join()
        assert report.n_files > 30
    rebuild(copy)
    assert verify(copy).is_sound
    with ResultStore(copy) as restored:
        for seed, sequence_id in enumerate(before):
            assert restored.sequence_record(sequence_id).subject == f"P {seed}"
            assert restored.sequence(sequence_id).id == sequence_id
            assert len(restored.signatures(sequence_id)) == 1
        assert visits(restored) == {7}
    assert (copy / "spool" / "x").read_text() == "acknowledged"


def test_a_second_backup_copies_what_is_new_and_forgets_what_was_deleted(tmp_path: Path) -> None:
    root, copy = tmp_path / "store", tmp_path / "copy"
    with ResultStore(root) as store:
        gone, stays = put(store, 1), put(store, 2)
        assert backup(root, copy).n_copied == 7
        store.update_sequence(stays, label="rest")
        store.delete_sequence(gone)
        report = backup(root, copy)
    # The databases, and the record that was replaced.
    assert (report.n_copied, report.n_removed, report.n_files) == (2, 3, 4)
    assert not [path for path in copy.rglob("*") if gone in path.name]
    with ResultStore(copy) as restored:
        assert restored.sequence_record(stays).label == "rest"
        with pytest.raises(NotFoundError):
            restored.sequence_record(gone)


def test_a_database_is_copied_again_when_it_has_changed(tmp_path: Path) -> None:
    root, copy = tmp_path / "store", tmp_path / "copy"
    with ResultStore(root) as store:
        put(store, 1)
    other = root / "access" / "closed.sqlite"
    other.parent.mkdir()
    with contextlib.closing(sqlite3.connect(other, isolation_level=None)) as file:
        file.execute("CREATE TABLE t (x)")
    backup(root, copy)
    assert backup(root, copy).n_copied == 0
    with contextlib.closing(sqlite3.connect(other, isolation_level=None)) as file:
        for number in range(4):
            # In its log what is new changes neither the file's size nor its time.
            file.execute(f"PRAGMA journal_mode = {'WAL' if number > 1 else 'DELETE'}")
            file.execute("INSERT INTO t VALUES (?)", (number,))
            assert backup(root, copy).n_copied == 1
            with contextlib.closing(sqlite3.connect(copy / "access" / "closed.sqlite")) as copied:
                assert copied.execute("SELECT count(*) FROM t").fetchone() == (number + 1,)


def test_a_backup_into_itself_or_over_other_files_is_refused(tmp_path: Path) -> None:
    root = tmp_path / "store"
    with ResultStore(root) as store:
        put(store, 1)
    for target in (root, root / "copy", tmp_path):
        with pytest.raises(ParameterError):
            backup(root, target)
    other = tmp_path / "other"
    other.mkdir()
    (other / "letter").write_text("mine")
    with pytest.raises(ParameterError, match="other files"):
        backup(root, other)
    assert (other / "letter").read_text() == "mine"
    shutil.rmtree(root)
    with pytest.raises(NotFoundError):
        backup(root, tmp_path / "new")
