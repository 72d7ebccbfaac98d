"""Tracks in a store: with their sequence, or not at all; in every list, copy and deletion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clouds import breathing_spheroid, sampled
from store_samples import sample_sequence

from modalmotion.errors import CorruptFileError, LostFileError, NotFoundError
from modalmotion.mesh import Facts
from modalmotion.store import (
    ResultStore,
    backup,
    rebuild,
    track_from_hdf5,
    track_image,
    track_to_hdf5,
    verify,
)
from modalmotion.store.folder import Folder, track_name
from modalmotion.tracking import Track, track


@pytest.fixture(scope="module")
def tracked() -> Track:
    beat, rng = breathing_spheroid(3), np.random.default_rng(0)
    clouds = [sampled(x, beat.faces, 80, rng, 0.3) for x in beat.vertices]
    found = track(clouds, modes=4, unit="mm")
    facts = found.sequence.facts.over(Facts(covariates={"age": 61}))
    return replace(found, sequence=found.sequence.with_facts(facts))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "store"


def test_a_track_and_its_sequence_are_kept_together(root: Path, tracked: Track) -> None:
    name = tracked.sequence.id
    with ResultStore(root) as store:
        with pytest.raises(NotFoundError, match="no track"):
            store.track(name)
        assert store.put_track(tracked, subject="P 1")
        assert not store.put_track(tracked, subject="P 2")
        again = store.track(name)
        assert track_to_hdf5(again) == track_to_hdf5(tracked)
        assert store.sequence(name).facts == tracked.sequence.facts
        assert store.track_record(name) == store.sequence_record(name)
        assert store.track_record(name).subject == "P 1"
        assert store.count() == {"sequence": 1, "track": 1}
        # Facts are in the record alone: what is taken back leaves no copy.
        store.update_sequence(name, change=lambda _: Facts())
        assert store.track(name).sequence.facts == Facts()
        assert not track_from_hdf5(store.track_path(name)).sequence.facts.stated
    assert verify(root).is_sound


def test_only_tracked_sequences_are_listed_as_tracks(root: Path, tracked: Track) -> None:
    with ResultStore(root) as store:
        for number in range(3):
            store.put_sequence(sample_sequence(number), label="beat")
        assert store.list_tracks().records == ()
        # Sent before by hand: what the store lacks is added.
        store.put_sequence(tracked.sequence, label="beat")
        with pytest.raises(NotFoundError):
            store.track_path(tracked.sequence.id)
        assert store.put_track(tracked)
        store.put_sequence(sample_sequence(7), label="beat")
        page = store.list_tracks(label="beat", limit=1)
        assert [record.id for record in page.records] == [tracked.sequence.id]
        assert page.cursor is None
        assert store.list_tracks(label="other").records == ()
        assert len(store.list_sequences().records) == 5


@pytest.mark.parametrize("keeps", [True, False])
def test_deleting_the_sequence_deletes_the_track(root: Path, tracked: Track, keeps: bool) -> None:
    name = tracked.sequence.id
    with ResultStore(root, keep_uploads=keeps) as store:
        store.put_track(tracked)
        assert store.sequence_record(name).has_upload is keeps
        store.delete_sequence(name)
        assert store.list_tracks().records == store.list_sequences().records == ()
        assert list((root / "tracks").rglob("*.h5")) == []
        assert store.put_track(tracked)


def test_a_backup_tells_deleted_tracks_from_lost_ones(
    tmp_path: Path, root: Path, tracked: Track
) -> None:
    copy, name = tmp_path / "copy", tracked.sequence.id
    path = Folder(root).result(track_name(name)).relative_to(root)
    with ResultStore(root) as store:
        store.put_track(tracked)
    backup(root, copy)
    kept = (root / path).read_bytes()
    (root / path).unlink()
    assert str(path) in backup(root, copy).missing
    assert (copy / path).is_file()
    # The index may have forgotten it; the copy has not.
    rebuild(root)
    assert str(path) in backup(root, copy).missing
    (root / path).write_bytes(kept)
    rebuild(root)
    with ResultStore(root) as store:
        store.delete_sequence(name)
    assert backup(root, copy).missing == ()
    assert not (copy / path).exists()


def test_a_track_is_verified_rebuilt_copied_and_missed(
    tmp_path: Path, root: Path, tracked: Track
) -> None:
    name, copy = tracked.sequence.id, tmp_path / "copy"
    path = Folder(root).result(track_name(name))
    with ResultStore(root) as store:
        store.put_track(tracked)
    backup(root, copy)
    assert (copy / path.relative_to(root)).read_bytes() == path.read_bytes()
    (root / "index.sqlite").unlink()
    assert rebuild(root).n_results == 1
    whole = path.read_bytes()
    moved = replace(tracked.sequence, vertices=tracked.sequence.vertices + 1.0)
    other = replace(tracked, sequence=moved)
    path.write_bytes(whole[:-9])
    (fault,) = verify(root).faults
    assert fault.file == str(path.relative_to(root))
    # Sealed, and of another sequence.
    path.write_bytes(track_image(other))
    assert not verify(root).is_sound
    with ResultStore(root) as store:
        with pytest.raises(CorruptFileError):
            store.track(name)
        path.unlink()
        with pytest.raises(LostFileError):
            store.track_path(name)
        # The same track again puts it right.
        assert not store.put_track(tracked)
    assert verify(root).is_sound
    assert path.read_bytes() == whole
