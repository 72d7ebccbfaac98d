"""Images in a store: held, listed, kept for a track, deleted for good, backed up, checked."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from modalmotion.errors import CorruptFileError, LostFileError, NotFoundError, ParameterError
from modalmotion.images import ImageSequence, Volume
from modalmotion.images.hdf5 import read_images_file, write_images
from modalmotion.notes import Note
from modalmotion.store import (
    ImagesRecord,
    ResultStore,
    VerifyReport,
    backup,
    images_record_of,
    rebuild,
    restore,
    verify,
)

TRACK = "f" * 64


def images(seed: int = 0) -> ImageSequence:
    rng = np.random.default_rng(seed)
    frames = [Volume(rng.integers(0, 9, (3, 4, 5)), np.diag([1.0, 2.0, 3.0, 1.0])) for _ in "ab"]
    return ImageSequence((*frames, None), np.array([0.0, 0.5, 1.0]), 1.5, (Note("told", "note"),))


def put(store: ResultStore, seed: int = 0) -> ImagesRecord:
    file = store.root / f"sent-{seed}"
    write_images(file, images(seed))
    record, _ = store.put_images(file, images_record_of(images(seed)))
    file.unlink(missing_ok=True)
    return record


@pytest.fixture
def store(tmp_path: Path) -> Iterator[ResultStore]:
    with ResultStore(tmp_path / "store") as opened:
        yield opened


def test_a_record_says_what_the_images_are(store: ResultStore) -> None:
    record = put(store)
    assert record == store.images_record(record.id)
    assert (record.kind, record.n_frames, record.missing) == ("volumes", 3, (2,))
    assert (record.shapes, record.spacings) == (((3, 4, 5),), ((1.0, 2.0, 3.0),))
    assert (record.times, record.period, record.n_bytes) == ((0.0, 0.5, 1.0), 1.5, 960)
    assert read_images_file(store.images_path(record.id)).id == record.id
    file = store.root / "again"
    write_images(file, images())
    assert store.put_images(file, images_record_of(images())) == (record, False)


def test_images_are_listed_from_the_newest_on(store: ResultStore) -> None:
    ids = [put(store, seed).id for seed in range(3)][::-1]
    page, following = store.list_images(limit=2)
    assert [one.id for one in page] == ids[:2]
    last, end = store.list_images(limit=2, cursor=following)
    assert ([one.id for one in last], end) == (ids[2:], None)
    with pytest.raises(ParameterError):
        store.list_images(limit=0)


def test_kept_images_know_their_track_until_it_is_deleted(store: ResultStore) -> None:
    one, other = put(store, 1), put(store, 2)
    with pytest.raises(NotFoundError, match="not kept"):
        store.images_of_track(TRACK)
    kept = store.keep_images(one.id, TRACK)
    assert (kept.is_kept, kept.tracks) == (True, (TRACK,))
    assert store.images_of_track(TRACK) == store.images_path(one.id)
    assert store.untracked_images("~") == (other.id,)
    assert store.untracked_images("0") == ()


def test_what_is_deleted_stays_away_and_may_come_again(store: ResultStore, tmp_path: Path) -> None:
    record = put(store)
    for path in store.root.rglob(f"{record.id}*"):
        # Of the same moment as the deletion they might have been put after it.
        os.utime(path, (path.stat().st_atime, path.stat().st_mtime - 1))
    copy = tmp_path / "copy"
    backup(store.root, copy)
    store.delete_images(record.id)
    assert not list(store.root.rglob(f"*{record.id}*"))
    for look in (store.images_record, store.images_path, store.delete_images):
        with pytest.raises(NotFoundError):
            look(record.id)
    report = backup(store.root, copy)
    assert (report.missing, report.n_removed >= 2) == ((), True)
    assert not list(copy.rglob(f"*{record.id}*"))
    # Written before the deletion, and put after it.
    file = store.root / "early"
    write_images(file, images())
    os.utime(file, (1e9, 1e9))
    store.put_images(file, images_record_of(images()))
    store.close()
    rebuild(store.root)
    with ResultStore(store.root) as again:
        assert again.images_path(record.id).is_file()


def test_old_files_laid_over_the_store_do_not_come_back(tmp_path: Path) -> None:
    root, copy = tmp_path / "store", tmp_path / "copy"
    with ResultStore(root) as store:
        record = put(store)
        kept = put(store, 1)
        backup(root, copy)
        store.delete_images(record.id)
    shutil.copytree(copy / "images", root / "images", dirs_exist_ok=True)
    rebuild(root)
    assert not list(root.rglob(f"*{record.id}*"))
    restore(copy, tmp_path / "new", deletions=root)
    with ResultStore(tmp_path / "new") as store:
        assert [one.id for one in store.list_images()[0]] == [kept.id]


def test_lost_samples_are_lost_and_not_deleted(store: ResultStore, tmp_path: Path) -> None:
    record = put(store)
    backup(store.root, tmp_path / "copy")
    store.images_path(record.id).unlink()
    with pytest.raises(LostFileError):
        store.images_path(record.id)
    report = backup(store.root, tmp_path / "copy")
    assert report.missing == (f"images/{record.id[:2]}/{record.id}.h5",)
    assert not verify_closed(store).is_sound


def verify_closed(store: ResultStore) -> VerifyReport:
    store.close()
    return verify(store.root)


def test_damage_is_found(store: ResultStore) -> None:
    record = put(store)
    path = store.images_path(record.id)
    data = bytearray(path.read_bytes())
    data[900] ^= 1
    path.write_bytes(data)
    with pytest.raises(CorruptFileError):
        read_images_file(path)
    report = verify_closed(store)
    assert [fault.file for fault in report.faults] == [f"images/{record.id[:2]}/{record.id}.h5"]


def test_samples_without_a_record_are_a_crash_that_the_next_start_clears(
    tmp_path: Path,
) -> None:
    store = ResultStore(tmp_path).open()
    record = put(store)
    store._folder.path("image_records", record.id).unlink()
    report = verify_closed(store)
    assert report.is_sound
    assert report.unfinished == (f"images/{record.id[:2]}/{record.id}.h5",)
    rebuild(tmp_path)
    assert not list(tmp_path.rglob(f"*{record.id}*"))
