"""A backup of a store in use holds everything that was acknowledged."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sqlite3
import threading
import time
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from service_table import visit, visits

from modalmotion.cli.commands import main
from modalmotion.errors import NotFoundError, ParameterError, StoreError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.making import modal_signature
from modalmotion.store import ResultStore, backup, rebuild, template_to_hdf5, verify
from modalmotion.store import backups as backup_module
from modalmotion.store.deletion import TOMBSTONE_DAYS, buried, was_deleted
from modalmotion.store.disk import sync_paths
from modalmotion.store.folders import FORM
from modalmotion.template import make_template


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
        # It is made again where it is missing.
        store.keep_rendered(stays, store.signatures(stays)[0], b"{}")
        assert backup(root, copy).n_copied == 7
        store.update_sequence(stays, label="rest")
        store.delete_sequence(gone)
        report = backup(root, copy)
    # The database, the record that was replaced, and the tombstone.
    assert (report.n_copied, report.n_removed, report.n_files) == (3, 3, 5)
    assert report.missing == ()
    assert not [path for path in copy.rglob("*") if gone in path.name]
    with ResultStore(copy) as restored:
        assert restored.sequence_record(stays).label == "rest"
        with pytest.raises(NotFoundError):
            restored.sequence_record(gone)


def test_what_is_unchanged_is_known_by_its_content_and_not_by_its_time(tmp_path: Path) -> None:
    root, copy = tmp_path / "store", tmp_path / "copy"
    with ResultStore(root) as store:
        put(store, 1)
    note = root / "access" / "note"
    note.parent.mkdir()
    note.write_bytes(b"a" * 1000)
    backup(root, copy)
    for path in root.rglob("*"):
        os.utime(path, (1, 1))
    # The database alone, which is always copied.
    assert backup(root, copy).n_copied == 1
    assert all(path.stat().st_mtime == 1 for path in copy.rglob("*.h5"))
    # The same size, time and last bytes.
    note.write_bytes(b"b" + b"a" * 999)
    os.utime(note, (1, 1))
    record = next(root.glob("sequences/*/*.json"))
    replaced = FORM.write(FORM.read(record) | {"subject": "P 2"})
    assert len(replaced) == record.stat().st_size
    record.write_bytes(replaced)
    os.utime(record, (1, 1))
    assert backup(root, copy).n_copied == 3
    assert (copy / "access" / "note").read_bytes() == note.read_bytes()
    assert (copy / record.relative_to(root)).read_bytes() == replaced


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


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A service's folder: a store with two sequences, another owner's with one."""
    folder = tmp_path / "data"
    for path, seeds in ((folder, (1, 2)), (folder / "owners" / "lab", (3,))):
        with ResultStore(path) as store:
            for seed in seeds:
                put(store, seed)
    (folder / "spool").mkdir()
    (folder / "spool" / "upload").write_text("under way")
    return folder


def command(*words: object) -> Result:
    return CliRunner().invoke(main, ["store", *map(str, words)])


@pytest.mark.every(2)
@pytest.mark.parametrize(
    "lost", ["sequences", "signatures", "index.sqlite", "owners", "owners/lab/sequences", "all"]
)
def test_a_backup_keeps_what_its_source_has_lost(root: Path, tmp_path: Path, lost: str) -> None:
    copy = tmp_path / "copy"
    backup(root, copy)
    before = files(copy)
    for path in root.iterdir() if lost == "all" else [root / lost]:
        path.rename(tmp_path / f"lost {path.name}")
    if lost != "index.sqlite":
        # As a service that is begun anew leaves it.
        with ResultStore(root):
            pass
    for _ in range(3):
        done = command("backup", root, copy)
        assert done.exit_code == 1
        (n_lost,) = re.findall(r"has lost (\d+) files", done.output)
        assert int(n_lost) == len(
            re.findall(r"^missing +(.*)$", done.output, re.MULTILINE)[0].split(", ")
        )
        assert files(copy) >= before
    # The remedy that the message names.
    done = command("restore", copy, root)
    assert done.exit_code == 0
    assert command("verify", root).exit_code == 0
    assert command("backup", root, copy).exit_code == 0
    with ResultStore(root / "owners" / "lab") as store:
        assert store.sequence_record(a_sequence(3).id).subject == "P 3"
        assert len(store.signatures(a_sequence(3).id)) == 1


def test_what_was_deleted_goes_at_once_while_what_was_lost_stays(
    root: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    with ResultStore(root) as store:
        new = a_sequence(9)
        image = tmp_path / "template.h5"
        image.write_bytes(template_to_hdf5(make_template(new)))
        template_id = make_template(new).id
        store.put_template_image(image, template_id)
    (root / "cohort.csv").write_text("a table")
    backup(root, copy)
    deleted, lost = a_sequence(1).id, a_sequence(2).id
    with ResultStore(root) as store:
        store.delete_sequence(deleted)
        store.delete_template(template_id)
        put(store, 4)
    (root / "sequences" / lost[:2] / f"{lost}.h5").unlink()
    (root / "cohort.csv").unlink()
    report = backup(root, copy)
    assert report.missing == (f"sequences/{lost[:2]}/{lost}.h5",)
    assert not [path for path in copy.rglob("*") if deleted in path.name]
    assert not [path for path in copy.rglob("*") if template_id in path.name]
    assert (copy / "sequences" / lost[:2] / f"{lost}.h5").exists()
    assert (copy / "cohort.csv").exists()
    # What is new is in the copy, and the index, which still knows what was lost, is today's.
    assert [path for path in copy.rglob("*") if a_sequence(4).id in path.name]
    assert b"P 1" not in (copy / "index.sqlite").read_bytes()
    # Gone on without it.
    rebuild(root)
    assert backup(root, copy, accept_missing=True).missing == ()
    assert not (copy / "sequences" / lost[:2] / f"{lost}.h5").exists()
    assert (copy / "cohort.csv").exists()
    assert backup(root, copy).missing == ()
    assert verify(copy).is_sound


def test_what_is_put_again_after_its_deletion_can_be_lost_too(root: Path, tmp_path: Path) -> None:
    copy, name = tmp_path / "copy", a_sequence(1).id
    with ResultStore(root) as store:
        store.delete_sequence(name)
        put(store, 1)
    backup(root, copy)
    upload = root / "sequences" / name[:2] / f"{name}.h5"
    upload.unlink()
    assert backup(root, copy).missing == (upload.relative_to(root).as_posix(),)
    assert (copy / "sequences" / name[:2] / f"{name}.h5").exists()


@pytest.mark.parametrize(("seconds", "was_there"), [(1.0, True), (0.02, True), (0.004, False)])
def test_times_of_files_lag_behind_and_what_is_put_again_at_once_stays(
    tmp_path: Path, seconds: float, was_there: bool
) -> None:
    image, sequence = tmp_path / "template.h5", a_sequence(1)
    template, root = make_template(sequence), tmp_path / "store"
    image.write_bytes(template_to_hdf5(template))
    with ResultStore(root) as store:
        for _ in range(2):
            put(store, 1)
            store.put_template_image(image, template.id)
            store.delete_sequence(sequence.id)
            store.delete_template(template.id)
        put(store, 1)
        store.put_template_image(image, template.id)
    for digest, path in (
        (sequence.id, root / "sequences" / sequence.id[:2] / f"{sequence.id}.h5"),
        (template.id, root / "templates" / template.id[:2] / f"{template.id}.h5"),
    ):
        deleted = buried(root, digest)
        assert deleted is not None
        time_of = datetime.fromisoformat(deleted).timestamp() - seconds
        os.utime(path, (time_of, time_of))
        assert was_deleted(root, path.relative_to(root), path.stat().st_mtime) is was_there
    rebuild(root)
    with ResultStore(root) as store:
        # Of a sequence the record tells, which has its time from another clock.
        assert store.has_sequence(sequence.id)
        assert store.templates() == (() if was_there else (template.id,))


def test_a_restored_copy_brings_nothing_back_without_a_word(root: Path, tmp_path: Path) -> None:
    copy, name = tmp_path / "copy", a_sequence(1).id
    backup(root, copy)
    with ResultStore(root) as store:
        store.delete_sequence(name)
    assert "what was deleted since is in it" in command("verify", copy).output
    # Into a new folder: it says what it cannot know, unless the remains are there to tell.
    done = command("restore", copy, tmp_path / "new")
    assert done.exit_code == 0
    assert "again: nothing here shows" in done.output
    assert name in ids(tmp_path / "new")
    done = command("restore", copy, tmp_path / "told", "--deletions", root)
    assert re.search(r"deleted +3\n", done.output)
    assert "again" not in done.output
    assert ids(tmp_path / "told") == {a_sequence(2).id}
    # Laid over the folder by hand, it is deleted once more.
    for path in copy.rglob(f"{name}*"):
        shutil.copy2(path, root / path.relative_to(copy))
    assert re.search(r"deletions +1\n", command("rebuild", root).output)
    assert ids(root) == {a_sequence(2).id}


def ids(root: Path) -> set[str]:
    with ResultStore(root) as store:
        return {record.id for record in store.list_sequences().records}


@pytest.mark.every(4)
@pytest.mark.parametrize("n", range(12))
def test_a_backup_that_is_cut_short_has_no_index_newer_than_its_files(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, n: int
) -> None:
    copy = tmp_path / "copy"
    backup(root, copy)
    with ResultStore(root) as store:
        put(store, 5)
        store.delete_sequence(a_sequence(1).id)
    left = iter(range(n))
    with monkeypatch.context() as cut:
        for name in ("replace", "unlink"):
            real = getattr(Path, name)

            def interrupted(path: Path, *values: Any, real: Any = real, **options: Any) -> Any:
                if copy in path.parents and next(left, None) is None:
                    raise KeyboardInterrupt
                return real(path, *values, **options)

            cut.setattr(Path, name, interrupted)
        with contextlib.suppress(KeyboardInterrupt):
            backup(root, copy)
    with contextlib.closing(sqlite3.connect(copy / "index.sqlite")) as index:
        for (name,) in index.execute("SELECT id FROM sequences"):
            if name != a_sequence(1).id:
                assert (copy / "sequences" / name[:2] / f"{name}.h5").exists()
    assert backup(root, copy).missing == ()
    assert verify(copy).is_sound


def test_what_is_copied_reaches_the_disk_before_the_index_does(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy, synced = tmp_path / "copy", []
    real = sync_paths

    def noted(paths: Iterable[Path]) -> None:
        listed = list(paths)
        synced.extend(listed)
        real(listed)

    monkeypatch.setattr(backup_module, "sync_paths", noted)
    backup(root, copy)
    n_files = len(files(copy)) - len({"lock", "backup.json"})
    assert sum(path.name.endswith(".tmp") for path in synced) == n_files
    folders = {path.parent for path in copy.rglob("*") if path.is_file()}
    assert folders <= set(synced)


def test_tombstones_say_nothing_and_are_forgotten(root: Path) -> None:
    name = a_sequence(1).id
    with ResultStore(root) as store:
        store.delete_sequence(name)
    (tombstone,) = (root / "deleted").glob("*/*")
    assert re.fullmatch(r"[0-9a-f]{64}", tombstone.name)
    assert name not in tombstone.name
    datetime.fromisoformat(tombstone.read_text())
    with ResultStore(root):
        assert tombstone.exists()
    old = time.time() - 86400 * (TOMBSTONE_DAYS + 1)
    os.utime(tombstone, (old, old))
    with ResultStore(root):
        assert not tombstone.exists()
    assert verify(root).orphans == ()


def test_a_store_in_use_is_not_a_backups_place(root: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    with ResultStore(other) as store:
        put(store, 7)
        with pytest.raises(ParameterError, match="other files"):
            backup(root, other)
    # And when it is closed.
    with pytest.raises(ParameterError, match="other files"):
        backup(root, other)
    assert ids(other) == {a_sequence(7).id}
    backup(root, tmp_path / "copy")
    with ResultStore(tmp_path / "copy"), pytest.raises(StoreError, match="in use by process"):
        backup(root, tmp_path / "copy")
