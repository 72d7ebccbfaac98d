from __future__ import annotations

import errno
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from small_disk import small_disk
from store_samples import (
    KEY,
    assert_same,
    put_classification,
    sample_classification,
    sample_sequence,
    sample_signature,
    tree,
)

from modalmotion.errors import NotFoundError, StoreError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.store import ResultStore, verify, write_atomic
from modalmotion.store.disk import is_of_the_machine
from modalmotion.store.folders import Folder


class BrokenDisk:
    """Lets a number of calls of one function of `os` through, and fails from then on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch
        self.calls = 0

    def fail(self, name: str, number: int, after: int, lasts: bool = True) -> None:
        original: Callable[..., object] = getattr(os, name)
        self.calls = 0

        def broken(*args: object, **options: object) -> object:
            self.calls += 1
            if self.calls == after + 1 or (lasts and self.calls > after):
                raise OSError(number, os.strerror(number))
            return original(*args, **options)

        self._monkeypatch.setattr(os, name, broken)

    def repair(self) -> None:
        self._monkeypatch.undo()


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> BrokenDisk:
    return BrokenDisk(monkeypatch)


def test_a_file_is_written_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a"
    write_atomic(path, b"first")
    write_atomic(path, memoryview(b"second"))
    assert tree(tmp_path) == {"a": b"second"}


def test_a_file_is_written_whole_by_a_system_that_takes_little_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write
    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:7]))
    write_atomic(tmp_path / "a", b"more than seven bytes")
    assert (tmp_path / "a").read_bytes() == b"more than seven bytes"


def test_the_file_and_then_its_folder_are_synchronised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    fsync, replace = os.fsync, Path.replace

    def noting_fsync(file: int) -> None:
        seen.append("folder" if os.path.isdir(f"/proc/self/fd/{file}") else "file")  # noqa: PTH112
        fsync(file)

    def noting_replace(path: Path, target: Path) -> Path:
        seen.append("rename")
        return replace(path, target)

    monkeypatch.setattr(os, "fsync", noting_fsync)
    monkeypatch.setattr(Path, "replace", noting_replace)
    write_atomic(tmp_path / "a", b"content")
    assert seen == ["file", "rename", "folder"]


def test_a_new_folder_of_a_store_is_synchronised_before_anything_is_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synchronised = set()
    fsync = os.fsync

    def noting(file: int) -> None:
        synchronised.add(Path(f"/proc/self/fd/{file}").readlink())
        fsync(file)

    monkeypatch.setattr(os, "fsync", noting)
    root = tmp_path / "deep" / "store"
    with ResultStore(root) as store:
        store.put_sequence(sample_sequence(1))
        folders = {path for path in [root, *root.rglob("*")] if path.is_dir()}
        assert {folder.parent for folder in folders} | folders <= synchronised


@pytest.mark.parametrize("before", [None, b"before"])
@pytest.mark.parametrize(
    ("name", "number", "after"),
    [
        ("write", errno.ENOSPC, 0),
        ("write", errno.EDQUOT, 0),
        ("fsync", errno.EIO, 0),
        ("fsync", errno.ENOSPC, 0),
        ("fsync", errno.EIO, 1),
    ],
)
def test_a_failing_write_changes_nothing(
    name: str, number: int, after: int, before: bytes | None, tmp_path: Path, disk: BrokenDisk
) -> None:
    path = tmp_path / "a"
    if before is not None:
        path.write_bytes(before)
    expected = tree(tmp_path)
    disk.fail(name, number, after)
    with pytest.raises(StoreError, match="'a' could not be written") as caught:
        write_atomic(path, b"new content")
    assert caught.value.remedy
    assert caught.value.details["errno"] == errno.errorcode[number]
    assert str(tmp_path) not in str(caught.value)
    assert tree(tmp_path) == expected


def test_a_folder_that_is_missing_is_an_error_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no folder 'missing'"):
        write_atomic(tmp_path / "missing" / "a", b"")


def _put_sequence(store: ResultStore) -> None:
    store.put_sequence(sample_sequence(2), subject="new")


def _put_signature(store: ResultStore) -> None:
    store.put_signature(sample_signature(sample_sequence(1), modes=4))


def _put_classification(store: ResultStore) -> None:
    put_classification(store, sample_classification(sample_sequence(1).id), "0" * 16)


def _update(store: ResultStore) -> None:
    store.update_sequence(sample_sequence(1).id, subject="changed")


def _state(store: ResultStore) -> object:
    known = sample_sequence(1).id
    return (
        tree(store.root),
        store.list_sequences(),
        store.signatures(known),
        store.classifications(known),
    )


def attempt(change: Callable[[], object]) -> StoreError | None:
    """Error that a change meets, None where it succeeds."""
    try:
        change()
    except StoreError as error:
        return error
    return None


CHANGES = [_put_sequence, _put_signature, _put_classification, _update]


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize(("name", "number"), [("fsync", errno.EIO), ("write", errno.ENOSPC)])
@pytest.mark.parametrize("lasts", [True, False])
def test_a_failing_disk_leaves_the_store_as_it_was(
    change: Callable[[ResultStore], None],
    name: str,
    number: int,
    lasts: bool,
    tmp_path: Path,
    disk: BrokenDisk,
) -> None:
    with ResultStore(tmp_path) as store:
        store.put_sequence(sample_sequence(1), subject="old")
        store.put_signature(sample_signature(sample_sequence(1)))
        before = _state(store)
        failures = 0
        for after in range(20):
            disk.fail(name, number, after, lasts)
            error = attempt(lambda: change(store))
            disk.repair()
            if error is None:
                break
            assert error.remedy
            assert _state(store) == before
            failures += 1
        assert failures > 0
        assert _state(store) != before
    assert verify(tmp_path).is_sound


def test_an_index_that_cannot_be_written_leaves_the_store_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ResultStore(tmp_path) as store:
        store.put_sequence(sample_sequence(1))
        before = _state(store)
        index = store._open_index()
        # A size that SQLite itself refuses to go beyond: its way of having a full disk.
        with index.database._write_lock:
            index.database._writer.execute("PRAGMA max_page_count = 1")
        failures = 0
        for number in range(2, 40):
            put = partial(store.put_sequence, sample_sequence(number))
            error = attempt(partial(put, subject="s" * 200, label="l" * 200))
            if error is None:
                before = _state(store)
            else:
                assert "nothing was changed" in error.message
                assert _state(store) == before
                failures += 1
        assert failures > 0
    assert verify(tmp_path).is_sound


@pytest.mark.parametrize("after", range(12))
def test_a_deletion_on_a_failing_disk_is_not_begun_or_finished_later(
    after: int, tmp_path: Path, disk: BrokenDisk
) -> None:
    sequence = sample_sequence(1)
    with ResultStore(tmp_path) as store:
        store.put_sequence(sequence)
        store.put_signature(sample_signature(sequence))
        before = tree(tmp_path)
        disk.fail("fsync", errno.EIO, after)
        error = attempt(lambda: store.delete_sequence(sequence.id))
        disk.repair()
        begun = error is None or "has begun" in error.message
        assert begun is (tree(tmp_path) != before)
    with ResultStore(tmp_path) as store:
        assert store.has_sequence(sequence.id) is not begun
        assert tree(tmp_path) == ({} if begun else before)
        if begun:
            with pytest.raises(NotFoundError):
                store.signatures(sequence.id)
    assert verify(tmp_path).is_sound


def test_a_deletion_that_failed_can_be_called_again_or_overtaken_by_a_new_put(
    tmp_path: Path, disk: BrokenDisk
) -> None:
    sequence = sample_sequence(1)
    with ResultStore(tmp_path) as store:
        for again in (store.delete_sequence, lambda _: store.put_sequence(sequence)):
            store.put_sequence(sequence, subject="old")
            store.put_signature(sample_signature(sequence))
            disk.fail("fsync", errno.EIO, 1)
            with pytest.raises(StoreError):
                store.delete_sequence(sequence.id)
            disk.repair()
            again(sequence.id)
        assert store.sequence_record(sequence.id).subject is None
        assert store.signatures(sequence.id) == ()
    assert verify(tmp_path).is_sound


def large(number: int) -> MeshSequence:
    return sample_sequence(number, n_frames=100)


def test_a_full_disk_refuses_what_is_new_keeps_what_is_old_and_recovers(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "2m") as disk:
        fill_and_empty(disk.folder)


def fill_and_empty(folder: Path) -> None:
    with ResultStore(folder / "store") as store:
        acknowledged: list[int] = []
        refused = 0
        for number in range(400):
            error = attempt(partial(store.put_sequence, large(number)))
            if error is None:
                acknowledged.append(number)
                continue
            assert error.remedy
            refused += 1
            if refused == 10:
                break
        assert refused == 10
        assert acknowledged
        for number in acknowledged:
            expected = large(number)
            assert_same(store.sequence(expected.id), expected)
        listed = {record.id for record in store.list_sequences(limit=1000).records}
        assert listed == {large(n).id for n in acknowledged}
        assert not list(folder.rglob("*.tmp"))
        # A full disk can be emptied through the store itself.
        for number in acknowledged[:5]:
            store.delete_sequence(large(number).id)
        assert store.put_sequence(sample_sequence(1000))
        store.put_signature(sample_signature(sample_sequence(1000)))
        assert store.signatures(sample_sequence(1000).id) == (KEY,)
    assert verify(folder / "store").is_sound


def test_what_may_succeed_at_another_time_is_no_fault_of_the_work() -> None:
    for number in (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EMFILE, errno.ESTALE):
        assert is_of_the_machine(OSError(number, "text"))
    for error in (FileNotFoundError(errno.ENOENT, "text"), OSError("text"), ValueError("text")):
        assert not is_of_the_machine(error)


def test_a_folder_of_results_that_cannot_be_read_is_no_empty_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Folder(tmp_path)
    shard = tmp_path / "signatures" / "ab"
    shard.mkdir(parents=True)

    def refuse(path: object = ".") -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    # Root may read all, so that rights alone would not show it.
    for name in ("scandir", "listdir"):
        monkeypatch.setattr(os, name, refuse)
    with pytest.raises(PermissionError):
        folder.derived("ab" * 32)
