"""What is put into a store, and what comes back."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clouds import breathing_spheroid, sampled
from store_samples import (
    KEY,
    MODEL,
    assert_same,
    put_classification,
    put_track,
    sample_classification,
    sample_sequence,
    sample_signature,
    tree,
)

from modalmotion.errors import CorruptFileError, LostFileError, NotFoundError, StoreError
from modalmotion.mesh import Facts
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import (
    ResultStore,
    backup,
    rebuild,
    template_from_hdf5,
    template_to_hdf5,
    track_from_hdf5,
    track_image,
    track_to_hdf5,
    verify,
)
from modalmotion.store.folders import Folder, track_name
from modalmotion.template import make_template
from modalmotion.tracking import Track, track


@pytest.fixture
def store(tmp_path: Path) -> Iterator[ResultStore]:
    with ResultStore(tmp_path / "store") as opened:
        yield opened
    assert verify(tmp_path / "store").is_sound


def test_making_a_store_touches_no_file_and_opening_makes_the_folder(tmp_path: Path) -> None:
    root = tmp_path / "deep" / "store"
    store = ResultStore(root)
    assert not root.parent.exists()
    with pytest.raises(StoreError, match="not open"):
        store.list_sequences()
    with store:
        assert root.is_dir()
        with pytest.raises(StoreError, match="open already"):
            store.open()
    with pytest.raises(StoreError, match="not open"):
        store.put_sequence(sample_sequence(1))


def test_what_is_put_comes_back_bit_for_bit_now_and_after_opening_again(tmp_path: Path) -> None:
    sequence = sample_sequence(1)
    signature = sample_signature(sequence)
    classification = sample_classification(sequence.id)
    with ResultStore(tmp_path) as store:
        assert store.put_sequence(sequence, subject="P 1", label="rest")
        path = store.put_signature(signature)
        assert path == store.signature_path(sequence.id, KEY)
        other = put_classification(store, classification, KEY)
        assert other == store.classification_path(sequence.id, MODEL, KEY)
    for _ in range(2):
        with ResultStore(tmp_path) as store:
            assert store.has_sequence(sequence.id)
            assert_same(store.sequence(sequence.id), sequence)
            assert_same(store.signature(sequence.id, KEY), signature)
            assert_same(store.classification(sequence.id, MODEL, KEY), classification)
            assert store.signatures(sequence.id) == (KEY,)
            assert store.classifications(sequence.id) == ((MODEL, KEY),)
            record = store.sequence_record(sequence.id)
            assert (record.n_frames, record.n_vertices, record.n_faces) == (4, 30, 0)
            assert (record.topology, record.grid, record.unit) == ("cup", (5, 6), "mm")
            assert (record.subject, record.label) == ("P 1", "rest")
            assert record.has_upload
            assert not record.has_times


def test_a_sequence_without_anything_optional_has_a_record_too(store: ResultStore) -> None:
    sequence = mesh_sequence(np.zeros((1, 3, 3)), [[0, 1, 2]])
    assert store.put_sequence(sequence)
    record = store.sequence_record(sequence.id)
    assert (record.topology, record.grid, record.unit) == (None, None, None)
    assert (record.subject, record.label) == (None, None)
    assert_same(store.sequence(sequence.id), sequence)


def test_what_is_known_is_not_written_again(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    assert store.put_sequence(sequence, subject="first")
    path = store.put_signature(sample_signature(sequence))
    before = path.stat().st_ino, store.sequence_record(sequence.id), tree(store.root)
    assert not store.put_sequence(sequence, subject="second")
    assert store.put_signature(sample_signature(sequence)) == path
    assert (path.stat().st_ino, store.sequence_record(sequence.id), tree(store.root)) == before


def test_each_choice_of_parameters_and_model_has_a_file_of_its_own(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    keys = set()
    for modes in (1, 4, 7):
        for reference in (0, 1):
            parameters = SignatureParameters(modes=modes, reference=reference)
            store.put_signature(modal_signature(sequence, parameters))
            keys.add(parameters.key)
            for model in ("a" * 64, "b" * 64):
                put_classification(store, sample_classification(sequence.id, model), parameters.key)
    assert set(store.signatures(sequence.id)) == keys
    expected = {(model, key) for model in ("a" * 64, "b" * 64) for key in keys}
    assert set(store.classifications(sequence.id)) == expected
    assert len(tree(store.root)) == 2 + 6 + 12


def test_a_damaged_file_is_named_and_healed_by_putting_it_again(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    signature = sample_signature(sequence)
    store.put_sequence(sequence)
    path = store.put_signature(signature)
    upload = next(store.root.glob(f"sequences/*/{sequence.id}.h5"))
    for broken in (path, upload):
        content = bytearray(broken.read_bytes())
        content[len(content) // 2] ^= 4
        broken.write_bytes(content)
    with pytest.raises(CorruptFileError, match=path.name):
        store.signature(sequence.id, KEY)
    with pytest.raises(CorruptFileError, match=upload.name):
        store.sequence(sequence.id)
    store.put_signature(signature)
    assert not store.put_sequence(sequence)
    assert_same(store.signature(sequence.id, KEY), signature)
    assert_same(store.sequence(sequence.id), sequence)


def test_a_file_under_another_name_is_not_taken_for_it(store: ResultStore) -> None:
    one, other = sample_sequence(1), sample_sequence(2)
    for sequence in (one, other):
        store.put_sequence(sequence)
        store.put_signature(sample_signature(sequence))
        put_classification(store, sample_classification(sequence.id), KEY)
    # Sound files, but each in the place of the other.
    for kind, read in (
        ("signatures", lambda: store.signature(one.id, KEY)),
        ("classifications", lambda: store.classification(one.id, MODEL, KEY)),
        ("sequences", lambda: store.sequence(one.id)),
    ):
        a = next(store.root.glob(f"{kind}/*/{one.id}*.h5"))
        b = next(store.root.glob(f"{kind}/*/{other.id}*.h5"))
        a_content, b_content = a.read_bytes(), b.read_bytes()
        a.write_bytes(b_content)
        with pytest.raises(CorruptFileError, match="another sequence id"):
            read()
        a.write_bytes(a_content)


def test_a_missing_file_is_no_unknown_id(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    path = store.put_signature(sample_signature(sequence))
    path.unlink()
    with pytest.raises(LostFileError, match=r"signature of sequence .* is lost"):
        store.signature(sequence.id, KEY)
    # As the remedy says.
    store.put_signature(sample_signature(sequence))
    store.signature(sequence.id, KEY)


def test_lost_vertices_are_no_unknown_id_and_come_back_with_the_sequence(
    store: ResultStore,
) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    store.sequence_path(sequence.id).unlink()
    for read in (store.sequence_path, store.sequence):
        with pytest.raises(LostFileError, match="lost: it was not deleted") as caught:
            read(sequence.id)
        assert caught.value.remedy.startswith("Send the sequence again")
    assert store.put_sequence(sequence) is False
    assert_same(store.sequence(sequence.id), sequence)
    # Deleted is another thing.
    store.sequence_path(sequence.id).unlink()
    store.delete_sequence(sequence.id)
    with pytest.raises(NotFoundError) as gone:
        store.sequence_path(sequence.id)
    assert not isinstance(gone.value, LostFileError)


BAD_IDS = [
    "",
    "a" * 63,
    "a" * 65,
    "A" * 64,
    "g" * 64,
    "a" * 64 + "\n",
    "../" * 21 + "a",
    "a" * 60 + "/../",
    "\x00" * 64,
    "٣" * 64,
    "0" * 64,
]


@pytest.mark.parametrize("bad", BAD_IDS)
def test_an_id_that_is_none_never_reaches_the_files(
    bad: str, store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    store.put_signature(sample_signature(sequence))

    def no_file(*args: object, **options: object) -> None:
        raise AssertionError("a file was touched")

    with monkeypatch.context() as patch:
        for name in ("open", "stat", "unlink", "mkdir", "scandir"):
            patch.setattr(os, name, no_file)
        assert not store.has_sequence(bad)
        for call in (
            lambda: store.sequence(bad),
            lambda: store.sequence_record(bad),
            lambda: store.update_sequence(bad, label="x"),
            lambda: store.delete_sequence(bad),
            lambda: store.signatures(bad),
            lambda: store.classifications(bad),
            lambda: store.signature(bad, KEY),
            lambda: store.signature_path(bad, KEY),
            lambda: store.classification(bad, MODEL, KEY),
            lambda: store.signature(sequence.id, bad),
            lambda: store.signature_path(sequence.id, bad),
            lambda: store.classification(sequence.id, bad, KEY),
            lambda: store.classification(sequence.id, MODEL, bad),
        ):
            with pytest.raises(NotFoundError) as caught:
                call()
            assert caught.value.remedy


def test_results_of_an_unknown_sequence_are_refused(store: ResultStore) -> None:
    signature = sample_signature(sample_sequence(1))
    with pytest.raises(NotFoundError):
        store.put_signature(signature)
    with pytest.raises(NotFoundError):
        store.put_signature(replace(signature, sequence_id="../../etc"))
    with pytest.raises(NotFoundError):
        put_classification(store, sample_classification("0" * 64), KEY)
    assert tree(store.root) == {}


@pytest.mark.parametrize(("model", "key"), [("../x", KEY), (MODEL, "../x"), (MODEL, "")])
def test_a_classification_under_no_digest_is_refused(
    model: str, key: str, store: ResultStore
) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    with pytest.raises(StoreError, match="digests"):
        put_classification(store, sample_classification(sequence.id, model), key)


def test_a_template_is_kept_once_and_found_by_its_id(store: ResultStore, tmp_path: Path) -> None:
    template = make_template(sample_sequence(1))
    image = tmp_path / "image.h5"
    image.write_bytes(template_to_hdf5(template))
    assert store.put_template_image(image, template.id)
    assert not store.put_template_image(image, template.id)
    path = store.template_path(template.id)
    assert_same(template_from_hdf5(path), template)
    damaged = path.read_bytes()[:-1]
    path.write_bytes(damaged)
    assert store.put_template_image(image, template.id)
    assert path.read_bytes() == image.read_bytes()
    for bad in ("0" * 64, "", "../" + "a" * 61):
        with pytest.raises(NotFoundError):
            store.template_path(bad)
    before = tree(store.root)
    with pytest.raises(StoreError, match="digest"):
        store.put_template_image(image, "../../x")
    image.write_bytes(damaged)
    with pytest.raises(CorruptFileError):
        store.put_template_image(image, "0" * 64)
    assert tree(store.root) == before


def test_without_uploads_only_what_is_known_is_kept(tmp_path: Path) -> None:
    sequence = sample_sequence(1)
    with ResultStore(tmp_path, keep_uploads=False) as store:
        assert store.put_sequence(sequence, subject="P 1")
        assert not store.put_sequence(sequence)
        store.put_signature(sample_signature(sequence))
        assert not store.sequence_record(sequence.id).has_upload
        with pytest.raises(NotFoundError, match="not kept") as caught:
            store.sequence(sequence.id)
        assert "keeps uploads" in caught.value.remedy
        store.signature(sequence.id, KEY)
    assert verify(tmp_path).is_sound
    with ResultStore(tmp_path) as store:
        assert not store.put_sequence(sequence)
        assert_same(store.sequence(sequence.id), sequence)
        record = store.sequence_record(sequence.id)
        assert (record.subject, record.has_upload) == ("P 1", True)
    assert verify(tmp_path).is_sound


def test_a_deleted_sequence_takes_everything_along(store: ResultStore) -> None:
    kept, gone = sample_sequence(1), sample_sequence(2)
    for sequence in (kept, gone):
        store.put_sequence(sequence)
        store.put_signature(sample_signature(sequence))
        put_classification(store, sample_classification(sequence.id), KEY)
    store.delete_sequence(gone.id)
    assert not store.has_sequence(gone.id)
    for call in (store.sequence, store.delete_sequence, store.signatures):
        with pytest.raises(NotFoundError):
            call(gone.id)
    with pytest.raises(NotFoundError):
        store.signature(gone.id, KEY)
    assert not [name for name in tree(store.root) if gone.id in name]
    assert len(tree(store.root)) == 4
    assert store.put_sequence(gone)
    assert store.signatures(gone.id) == ()
    assert_same(store.signature(kept.id, KEY), sample_signature(kept))


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
        assert put_track(store, tracked, subject="P 1")
        assert not put_track(store, tracked, subject="P 2")
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
        assert store.list_sequences(tracked=True).records == ()
        # Sent before by hand: what the store lacks is added.
        store.put_sequence(tracked.sequence, label="beat")
        with pytest.raises(NotFoundError):
            store.track_path(tracked.sequence.id)
        assert put_track(store, tracked)
        store.put_sequence(sample_sequence(7), label="beat")
        page = store.list_sequences(tracked=True, label="beat", limit=1)
        assert [record.id for record in page.records] == [tracked.sequence.id]
        assert page.cursor is None
        assert store.list_sequences(tracked=True, label="other").records == ()
        assert len(store.list_sequences().records) == 5


@pytest.mark.parametrize("keeps", [True, False])
def test_deleting_the_sequence_deletes_the_track(root: Path, tracked: Track, keeps: bool) -> None:
    name = tracked.sequence.id
    with ResultStore(root, keep_uploads=keeps) as store:
        put_track(store, tracked)
        assert store.sequence_record(name).has_upload is keeps
        store.delete_sequence(name)
        assert store.list_sequences(tracked=True).records == store.list_sequences().records == ()
        assert list((root / "tracks").rglob("*.h5")) == []
        assert put_track(store, tracked)


def test_a_backup_tells_deleted_tracks_from_lost_ones(
    tmp_path: Path, root: Path, tracked: Track
) -> None:
    copy, name = tmp_path / "copy", tracked.sequence.id
    path = Folder(root).path("results", track_name(name)).relative_to(root)
    with ResultStore(root) as store:
        put_track(store, tracked)
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
    path = Folder(root).path("results", track_name(name))
    with ResultStore(root) as store:
        put_track(store, tracked)
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
        assert not put_track(store, tracked)
    assert verify(root).is_sound
    assert path.read_bytes() == whole
