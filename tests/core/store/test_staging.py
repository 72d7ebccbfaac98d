"""Results that other processes wrote are moved in together: all of them, or none."""

from __future__ import annotations

import errno
import itertools
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from store_samples import KEY, assert_same, sample_sequence, sample_signature, tree

from modalmotion.errors import CorruptFileError, ModalMotionError, ParameterError, StoreError
from modalmotion.store import (
    ResultStore,
    StagedSignature,
    record_of,
    record_to_json,
    sequence_to_hdf5,
    signature_to_hdf5,
    verify,
)
from modalmotion.store.disk.group_commit import GroupCommit, sync_paths
from modalmotion.store.index.database import Database

NUMBERS = range(1, 8)


def made_of(
    folder: Path, number: int, *, modes: int = 7, vertices: bool = True, subject: str | None = None
) -> StagedSignature:
    """What a worker leaves of a sequence."""
    folder.mkdir(exist_ok=True)
    sequence = sample_sequence(number)
    signature = sample_signature(sequence, modes)
    record = record_of(sequence, created="2026-01-01", has_upload=vertices, subject=subject)
    paths = [folder / f"{number}.{modes}.{name}" for name in ("record", "signature", "vertices")]
    paths[0].write_bytes(record_to_json(record))
    paths[1].write_bytes(signature_to_hdf5(signature))
    paths[2].write_bytes(sequence_to_hdf5(sequence))
    kept = paths[2] if vertices else None
    return StagedSignature(record, paths[0], signature.parameters.key, paths[1], kept)


def contents(root: Path) -> dict[str, bytes]:
    return {name: data for name, data in tree(root).items() if not name.startswith("spool")}


@contextmanager
def failing(name: str, after: int, fault: Callable[[], object]) -> Iterator[None]:
    original: Callable[..., object] = getattr(os, name)
    # Several threads take their numbers from it.
    numbers = itertools.count()

    def broken(*args: object, **options: object) -> object:
        if next(numbers) == after:
            fault()
        return original(*args, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, name, broken)
        yield


def refuse() -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def test_together_is_as_one_by_one(tmp_path: Path) -> None:
    together, alone = tmp_path / "together", tmp_path / "alone"
    with ResultStore(together) as store:
        made = [made_of(together / "spool", number, subject="P 1") for number in NUMBERS]
        assert store.put_staged(made) == (True,) * len(made)
        assert list((together / "spool").iterdir()) == []
        for number in NUMBERS:
            sequence = sample_sequence(number)
            assert_same(store.sequence(sequence.id), sequence)
            assert_same(store.signature(sequence.id, KEY), sample_signature(sequence))
    with ResultStore(alone) as store:
        for number in NUMBERS:
            store.put_sequence(sample_sequence(number), subject="P 1")
            store.put_signature(sample_signature(sample_sequence(number)))
    found, expected = contents(together), contents(alone)
    assert found.keys() == expected.keys()
    # Records differ in when they came.
    assert all(found[name] == expected[name] for name in found if name.endswith(".h5"))
    report = verify(together)
    assert report.is_sound
    assert not report.orphans
    assert not report.unfinished


def test_many_cost_one_transaction(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, n_written = Database.write, 0

    def counting(database: Database) -> object:
        nonlocal n_written
        n_written += 1
        return write(database)

    with ResultStore(tmp_path) as store:
        made = [made_of(tmp_path / "spool", number) for number in NUMBERS]
        monkeypatch.setattr(Database, "write", counting)
        store.put_staged(made)
        assert n_written == 1
        assert store.put_staged([]) == ()
        assert n_written == 1


def test_what_is_known_stays_and_only_what_is_missing_is_taken(tmp_path: Path) -> None:
    spool = tmp_path / "spool"
    with ResultStore(tmp_path) as store:
        first, again = made_of(spool, 1, subject="P 1"), made_of(spool, 1, modes=4, subject="P 2")
        # Two of one sequence in one go: the first one's record is kept, and both signatures.
        assert store.put_staged([first, again]) == (True, False)
        assert again.record_file.exists()
        assert store.sequence_record(first.record.id).subject == "P 1"
        assert len(store.signatures(first.record.id)) == 2
        before = contents(tmp_path)
        assert store.put_staged([made_of(spool, 1), made_of(spool, 1, modes=4)]) == (False, False)
        assert contents(tmp_path) == before
        # A damaged file is replaced by a sound one.
        for path in (
            store.sequence_path(first.record.id),
            store.signature_path(first.record.id, KEY),
        ):
            path.write_bytes(path.read_bytes()[:-1])
        store.put_staged([made_of(spool, 1)])
        assert contents(tmp_path) == before
    assert verify(tmp_path).is_sound


def test_vertices_are_added_to_a_sequence_that_had_none(tmp_path: Path) -> None:
    spool, sequence = tmp_path / "spool", sample_sequence(1)
    with ResultStore(tmp_path) as store:
        store.put_staged([made_of(spool, 1, vertices=False, subject="P 1")])
        assert not store.sequence_record(sequence.id).has_upload
        assert store.put_staged([made_of(spool, 1, subject="P 2")]) == (False,)
        record = store.sequence_record(sequence.id)
        assert (record.subject, record.has_upload) == ("P 1", True)
        assert_same(store.sequence(sequence.id), sequence)
    assert verify(tmp_path).is_sound


def test_what_is_wrong_with_one_keeps_them_all_out(tmp_path: Path) -> None:
    spool = tmp_path / "spool"
    with ResultStore(tmp_path) as store:
        sound = made_of(spool, 1)
        wrong: list[tuple[type[ModalMotionError], StagedSignature]] = [
            (StoreError, replace(made_of(spool, 2), key="../../x")),
            (
                StoreError,
                replace(made_of(spool, 2), record=replace(made_of(spool, 2).record, id="../../x")),
            ),
            (ParameterError, made_of(spool, 2, subject="s" * 1000)),
            (StoreError, replace(made_of(spool, 2), signature=spool / "missing")),
        ]
        cut = made_of(spool, 3)
        cut.signature.write_bytes(cut.signature.read_bytes()[:-1])
        changed = made_of(spool, 4)
        assert changed.vertices is not None
        changed.vertices.write_bytes(b"\0" + changed.vertices.read_bytes()[1:])
        wrong += [(CorruptFileError, cut), (CorruptFileError, changed)]
        for error, one in wrong:
            with pytest.raises(error):
                store.put_staged([sound, one])
            assert contents(tmp_path) == {}
            assert store.count() == {"sequence": 0}
        assert store.put_staged([sound]) == (True,)


@pytest.mark.parametrize("name", ["fsync", "replace"])
def test_a_failing_disk_leaves_the_store_as_it_was(name: str, tmp_path: Path) -> None:
    spool = tmp_path / "spool"
    with ResultStore(tmp_path) as store:
        store.put_staged([made_of(spool, 1, vertices=False)])
        before, counted = contents(tmp_path), store.count()
        for after in range(100):
            made = [made_of(spool, number) for number in (1, 2, 3)]
            try:
                with failing(name, after, refuse):
                    store.put_staged(made)
            except StoreError as error:
                assert error.remedy  # noqa: PT017 (the last round raises nothing)
                assert (contents(tmp_path), store.count()) == (before, counted)
            else:
                break
        assert after > 3
        assert store.count() == {"sequence": 3, "signature": 3}
    assert verify(tmp_path).is_sound


@pytest.mark.every(2)
@pytest.mark.parametrize("name", ["fsync", "replace"])
def test_killed_at_any_step_it_is_done_again(name: str, tmp_path: Path) -> None:
    for after in range(100):
        root = tmp_path / f"{after}"
        made = [made_of(tmp_path / f"spool{after}", number) for number in (1, 2, 3)]
        child = os.fork()
        if not child:
            with ResultStore(root) as store, failing(name, after, lambda: os._exit(9)):
                store.put_staged(made)
                os._exit(0)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        assert verify(root).is_sound
        with ResultStore(root) as store:
            if code == 0:
                assert store.count() == {"sequence": 3, "signature": 3}
            again = [made_of(tmp_path / f"spool{after}", number) for number in (1, 2, 3)]
            store.put_staged(again)
            for number in (1, 2, 3):
                sequence = sample_sequence(number)
                assert_same(store.sequence(sequence.id), sequence)
                assert_same(store.signature(sequence.id, KEY), sample_signature(sequence))
        report = verify(root)
        assert report.is_sound
        assert not report.orphans
        if code == 0:
            assert after > 5
            return
        assert code == 9
    raise AssertionError("it was never finished")


def test_files_are_durable_before_they_have_their_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []
    fsync, replace_file = os.fsync, os.replace

    def noting_fsync(file: int) -> None:
        fsync(file)
        seen.append("file")

    def noting_replace(source: Path, target: Path) -> None:
        seen.append("rename")
        replace_file(source, target)

    monkeypatch.setattr(os, "fsync", noting_fsync)
    monkeypatch.setattr(os, "replace", noting_replace)
    with GroupCommit() as files:
        for number in range(9):
            files.write(tmp_path / f"{number}", b"x" * number)
        assert all(path.name.endswith(".tmp") for path in tmp_path.iterdir())
    assert seen == ["file"] * 9 + ["rename"] * 9
    assert tree(tmp_path) == {f"{number}": b"x" * number for number in range(9)}


@pytest.mark.parametrize("n_files", [1, 9])
def test_of_files_that_cannot_be_written_nothing_is_left(n_files: int, tmp_path: Path) -> None:
    def write(then: Callable[[], object] = lambda: None) -> None:
        with GroupCommit() as files:
            for number in range(n_files):
                files.write(tmp_path / f"{number}", b"x")
            then()

    with pytest.raises(ZeroDivisionError):
        write(lambda: 1 / 0)
    assert tree(tmp_path) == {}
    with failing("fsync", n_files - 1, refuse), pytest.raises(StoreError):
        write()
    assert tree(tmp_path) == {}
    with GroupCommit() as files, pytest.raises(StoreError, match="could not be written"):
        files.write(tmp_path / "no folder" / "a", b"x")


def test_each_path_is_synchronised_once_and_a_missing_one_is_told(tmp_path: Path) -> None:
    with failing("fsync", 1, refuse):
        sync_paths([tmp_path] * 3)
    for n in (1, 9):
        with pytest.raises(FileNotFoundError):
            sync_paths([*(tmp_path for _ in range(n)), tmp_path / "missing"])
