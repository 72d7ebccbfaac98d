"""A sequence takes the place of another: at any moment one of the two is stored, whole."""

from __future__ import annotations

import errno
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from store_samples import KEY, sample_sequence, sample_signature, tree

from modalmotion.errors import ParameterError, StoreError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.store import ResultStore, SequenceRecord, record_of, upload_image, verify

OLD = sample_sequence(1)
NEW = OLD.with_unit("m")
# What leaves a trace on the disk, as the store calls it.
STEPS = ("fsync", "replace", "unlink")


def stored(root: Path) -> Path:
    """A store with the old one and its signature, and beside it the new one's file."""
    with ResultStore(root) as store:
        store.put_sequence(OLD, subject="P 7", label="normal")
        store.put_signature(sample_signature(OLD))
    image = root.parent / "new.h5"
    image.write_bytes(upload_image(NEW))
    return image


def put_in_its_place(store: ResultStore, image: Path, **changes: Any) -> SequenceRecord:
    record = record_of(NEW, created="", has_upload=True)
    return store.replace_sequence(
        OLD.id, image, record, lambda known: replace(known, name="beat", **changes)
    )


def the_one_that_is_there(root: Path) -> MeshSequence:
    """Open a store after a crash: it has one of the two, with its names and results."""
    with ResultStore(root) as store:
        (record,) = store.list_sequences().records
        assert (record.subject, record.label) == ("P 7", "normal")
        is_new = record.id == NEW.id
        assert record.name == ("beat" if is_new else None)
        expected = NEW if is_new else OLD
        assert store.sequence(record.id).vertices.tobytes() == expected.vertices.tobytes()
        assert list(store.signatures(record.id)) == ([] if is_new else [KEY])
    other = OLD if is_new else NEW
    assert not [name for name in tree(root) if other.id in name]
    report = verify(root)
    assert (report.faults, report.unfinished, report.orphans) == ((), (), ())
    return expected


def killed_before_step(number: int, root: Path, image: Path) -> bool:
    """Whether a process that was ended at one step had that many to do."""
    if not (child := os.fork()):
        left = [number]

        def ending(step: Any) -> Any:
            def call(*arguments: Any, **options: Any) -> Any:
                if not left[0]:
                    os._exit(9)
                left[0] -= 1
                return step(*arguments, **options)

            return call

        try:
            with ResultStore(root) as store:
                for name in STEPS:
                    setattr(os, name, ending(getattr(os, name)))
                put_in_its_place(store, image)
                os._exit(0)
        finally:
            os._exit(1)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (0, 9)
    return code == 9


def test_a_process_that_is_killed_at_any_step_leaves_one_of_the_two(tmp_path: Path) -> None:
    found, number, is_killed = [], 0, True
    made = tmp_path / "made" / "store"
    made.parent.mkdir()
    image = stored(made)
    while is_killed:
        root = tmp_path / str(number) / "store"
        shutil.copytree(made.parent, root.parent)
        is_killed = killed_before_step(number, root, image)
        found.append(the_one_that_is_there(root).id)
        number += 1
    # First the old one, from one step on the new one.
    n_old = found.count(OLD.id)
    assert found == [OLD.id] * n_old + [NEW.id] * (len(found) - n_old)
    assert n_old > 5
    assert len(found) - n_old > 5


@pytest.mark.parametrize("step", STEPS[:2])
def test_a_disk_that_fails_at_any_step_leaves_the_store_as_it_was(
    tmp_path: Path, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, number, has_failed = getattr(os, step), 0, True
    made = tmp_path / "made" / "store"
    made.parent.mkdir()
    image = stored(made)
    while has_failed:
        root = tmp_path / str(number) / "store"
        shutil.copytree(made.parent, root.parent)
        left = [number]

        def failing(*arguments: Any, left: list[int] = left, **options: Any) -> Any:
            left[0] -= 1
            if left[0] == -1:
                raise OSError(errno.ENOSPC, "full")
            return own(*arguments, **options)

        with ResultStore(root) as store:
            monkeypatch.setattr(os, step, failing)
            try:
                put_in_its_place(store, image)
            except StoreError:
                assert store.sequence(OLD.id).vertices.tobytes() == OLD.vertices.tobytes()
                assert not store.has_sequence(NEW.id)
            finally:
                monkeypatch.setattr(os, step, own)
        has_failed = left[0] < 0
        the_one_that_is_there(root)
        number += 1
    assert number > 2


def test_what_does_not_fit_changes_nothing(tmp_path: Path) -> None:
    image = stored(tmp_path / "store")
    with ResultStore(tmp_path / "store") as store, pytest.raises(ParameterError):
        put_in_its_place(store, image, subject="a\nb")
    assert the_one_that_is_there(tmp_path / "store") is OLD


def test_one_that_is_known_is_changed_and_the_old_one_goes(tmp_path: Path) -> None:
    image = stored(tmp_path / "store")
    with ResultStore(tmp_path / "store") as store:
        store.put_sequence(NEW, subject="P 8")
        created = store.sequence_record(NEW.id).created
        assert put_in_its_place(store, image).created == created
    assert the_one_that_is_there(tmp_path / "store") is NEW
