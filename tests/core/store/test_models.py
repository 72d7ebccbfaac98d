"""Models in the store: numbered, immutable, found again, deleted, never given a number twice."""

from __future__ import annotations

import errno
import json
import os
import shutil
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from norm_controls import drawn, norm_of
from store_samples import (
    KEY,
    put_classification,
    sample_classification,
    sample_model,
    sample_sequence,
    tree,
)

from modalmotion.classification import Model, load_model
from modalmotion.classification.model_files import read_kept_model
from modalmotion.errors import (
    CorruptFileError,
    LostFileError,
    NotFoundError,
    ParameterError,
    StoreError,
)
from modalmotion.norm import Norm
from modalmotion.store import (
    ModelReference,
    ResultStore,
    backup,
    kept_model,
    model_from_hdf5,
    model_to_hdf5,
    parse_reference,
    rebuild,
    require_model_name,
    restore,
    verify,
)
from modalmotion.store.folders import Folder


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model()


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A store with three versions of one model, of which the second is deleted, and another."""
    with ResultStore(tmp_path / "store") as store:
        for number in range(3):
            store.put_model(sample_model(number))
        store.put_model(sample_model(7, name="other"))
        store.delete_model("wall-motion", 2)
    return tmp_path / "store"


@pytest.mark.parametrize("name", ["a", "7", "wall-motion", "lv.v2_b", "a" * 64])
def test_names_that_can_be_folders_are_names(name: str) -> None:
    assert require_model_name(name) == name
    assert parse_reference(name) == ModelReference(name, None)
    assert parse_reference(f"{name}@12") == ModelReference(name, 12)
    assert str(parse_reference(f"{name}@12")) == f"{name}@12"


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a/b", "-a", "a-", "A", "a" * 65, "a b", "a@1", "ä", "a\n", "../x"]
)
def test_other_names_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="cannot be called") as caught:
        require_model_name(name)
    assert "lower-case" in caught.value.remedy
    with ResultStore(tmp_path) as store:
        with pytest.raises(ParameterError):
            store.put_model(sample_model(name=name))
        with pytest.raises(NotFoundError):
            store.model_record(name)
        assert not (tmp_path / "models").exists()


@pytest.mark.parametrize("text", ["a@", "a@0", "a@01", "a@-1", "a@1.0", "a@1@2", "@1", "a@1\n"])
def test_what_names_no_version_is_refused(text: str) -> None:
    with pytest.raises(NotFoundError, match="is not the name of a model"):
        parse_reference(text)


def test_each_model_put_is_the_next_version(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        made = [store.put_model(sample_model(number)) for number in range(3)]
        other = store.put_model(sample_model(0, name="other"))
        assert [record.version for record in made] == [1, 2, 3]
        assert other.version == 1
        # The same model again is another version: it is a name's history, not a set.
        assert store.put_model(sample_model(2)).version == 4
        assert store.model_record("wall-motion").version == 4
        assert store.model_record("wall-motion", 2) == made[1]
        for record, number in zip(made, range(3), strict=True):
            kept = store.kept_model(record.name, record.version)
            assert kept.record == record
            assert kept.card == sample_model(number).card
            assert np.array_equal(
                kept.arrays["strangeness"], sample_model(number).arrays["strangeness"]
            )
            assert record.created > "2"
            assert record.parameters == sample_model(number).record.parameters
        assert {str(r.reference) for r in store.models()} == {
            *("wall-motion@1", "wall-motion@2", "wall-motion@3", "wall-motion@4", "other@1")
        }
        assert [r.version for r in store.model_versions("wall-motion")] == [1, 2, 3, 4]
        with_id = store.models_with_id(made[2].id)
        assert [r.version for r in with_id] == [3, 4]


def test_models_put_at_once_get_distinct_versions(tmp_path: Path) -> None:
    made: list[int] = []
    with ResultStore(tmp_path) as store:
        numbers = range(12)

        def put(number: int) -> None:
            made.append(store.put_model(sample_model(number)).version)

        threads = [threading.Thread(target=put, args=[number]) for number in numbers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(made) == [number + 1 for number in numbers]
        ids = {store.kept_model("wall-motion", n + 1).record.id for n in numbers}
        assert ids == {sample_model(number).record.id for number in numbers}


def test_a_training_that_is_begun_again_puts_one_version(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        first = store.put_model(sample_model(1, training="t1"))
        assert store.put_model(sample_model(1, training="t1")) == first
        assert store.model_of_training("t1") == first
        assert store.model_of_training("t2") is None
        assert store.put_model(sample_model(1, training="t2")).version == 2


def test_a_deleted_version_is_gone_and_its_number_stays_taken(root: Path) -> None:
    with ResultStore(root) as store:
        with pytest.raises(NotFoundError, match="was deleted") as caught:
            store.model_record("wall-motion", 2)
        assert "1, 3" in caught.value.remedy
        with pytest.raises(NotFoundError):
            store.delete_model("wall-motion", 2)
        assert not (root / "models/wall-motion/2.h5").exists()
        assert [r.version for r in store.model_versions("wall-motion")] == [1, 3]
        # The newest one deleted: the number is not given again, not even by a new process.
        store.delete_model("wall-motion", 3)
        assert store.model_record("wall-motion").version == 1
        assert store.put_model(sample_model(5)).version == 4
        store.delete_model("wall-motion", 4)
    with ResultStore(root) as store:
        assert store.put_model(sample_model(5)).version == 5
    (root / "index.sqlite").unlink()
    with ResultStore(root) as store:
        assert store.put_model(sample_model(5)).version == 6
        known = store.models_with_id(sample_model(1).record.id)
        assert [(r.name, r.version, r.deleted is not None) for r in known] == [
            ("wall-motion", 2, True)
        ]


def test_a_name_all_of_whose_versions_are_deleted_is_free_but_for_its_numbers(root: Path) -> None:
    with ResultStore(root) as store:
        store.delete_model("other", 1)
        with pytest.raises(NotFoundError, match="all of its versions"):
            store.model_record("other")
        with pytest.raises(NotFoundError):
            store.model_versions("other")
        assert store.put_model(sample_model(8, name="other")).version == 2


def test_what_a_deleted_model_said_stays(root: Path) -> None:
    sequence = sample_sequence(1)
    with ResultStore(root) as store:
        record = store.model_record("wall-motion", 3)
        store.put_sequence(sequence)
        put_classification(store, sample_classification(sequence.id, record.id), KEY)
        store.delete_model("wall-motion", 3)
        assert store.classifications(sequence.id) == ((record.id, KEY),)
        assert store.classification(sequence.id, record.id, KEY).label == "normal"


def test_an_index_built_anew_knows_the_same_models(root: Path) -> None:
    with ResultStore(root) as store:
        before, gone = store.models(), store.models_with_id(sample_model(1).record.id)
    files = tree(root)
    (root / "index.sqlite").unlink()
    assert rebuild(root).n_models == 3
    with ResultStore(root) as store:
        assert store.models() == before
        assert store.models_with_id(sample_model(1).record.id) == gone
    assert tree(root) == files
    report = verify(root)
    assert (report.faults, report.unfinished, report.orphans) == ((), (), ())
    assert report.n_models == 3


def crashed(root: Path, change: Callable[[ResultStore], object]) -> None:
    """Let a process do something and end without closing the store."""
    store = ResultStore(root).open()
    change(store)
    store._is_clean = False
    store.close()


def test_a_version_that_a_crash_left_unindexed_is_found(root: Path) -> None:
    def put(store: ResultStore) -> None:
        store.put_model(sample_model(9))
        with store._open_index().database.write() as connection:
            connection.execute("DELETE FROM models WHERE version = 4")

    crashed(root, put)
    with ResultStore(root) as store:
        assert store.model_record("wall-motion").version == 4
        assert store.put_model(sample_model(9)).version == 5


def test_a_deletion_that_a_crash_interrupted_is_finished(root: Path) -> None:
    kept = (root / "models/wall-motion/3.h5").read_bytes()

    def delete(store: ResultStore) -> None:
        store.delete_model("wall-motion", 3)
        (root / "models/wall-motion/3.h5").write_bytes(kept)

    crashed(root, delete)
    report = verify(root)
    assert report.is_sound
    assert "models/wall-motion/3.h5" in report.unfinished
    with ResultStore(root) as store:
        assert [r.version for r in store.model_versions("wall-motion")] == [1]
    assert not (root / "models/wall-motion/3.h5").exists()


@pytest.mark.parametrize("step", ["write", "fsync", "replace"])
def test_a_full_disk_leaves_no_half_version(
    root: Path, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ResultStore(root) as store:
        before = tree(root)
        full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        def fail(*_: object, **__: object) -> None:
            raise full

        with monkeypatch.context() as patched:
            patched.setattr(Path if step == "replace" else os, step, fail)
            with pytest.raises(StoreError):
                store.put_model(sample_model(9))
        assert tree(root) == before
        assert store.model_record("wall-motion").version == 3
        assert store.put_model(sample_model(9)).version == 4


def test_a_failing_index_takes_the_file_back(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from modalmotion.store.index import Index

    def fail(*_: object) -> None:
        raise StoreError("The index could not be written.")

    with ResultStore(root) as store:
        before = tree(root)
        with monkeypatch.context() as patched:
            patched.setattr(Index, "put_model", fail)
            with pytest.raises(StoreError):
                store.put_model(sample_model(9))
        assert tree(root) == before
        assert store.put_model(sample_model(9)).version == 4


def damage(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x41
    path.write_bytes(content)


def test_a_damaged_model_is_refused_and_the_others_are_served(root: Path) -> None:
    damage(root / "models/wall-motion/3.h5")
    assert [fault.file for fault in verify(root).faults] == ["models/wall-motion/3.h5"]
    with ResultStore(root) as store:
        with pytest.raises(CorruptFileError, match="damaged"):
            store.kept_model("wall-motion", 3)
        assert store.kept_model("wall-motion", 1).record.version == 1
    found = rebuild(root)
    assert found.damaged == ("models/wall-motion/3.h5",)
    with ResultStore(root) as store:
        with pytest.raises(NotFoundError):
            store.model_record("wall-motion", 3)
        # What is damaged is nobody's to write over.
        assert store.put_model(sample_model(9)).version == 4


def test_a_damaged_note_of_a_deletion_keeps_the_number_taken(root: Path) -> None:
    path = root / "models/wall-motion/2.deleted"
    with ResultStore(root) as store:
        store.delete_model("wall-motion", 3)
    path.with_name("3.deleted").write_text("{}")
    assert not verify(root).is_sound
    (root / "index.sqlite").unlink()
    assert rebuild(root).damaged == ("models/wall-motion/3.deleted",)
    with ResultStore(root) as store:
        assert store.put_model(sample_model(9)).version == 4


def test_a_file_under_another_name_is_refused(root: Path) -> None:
    folder = Folder(root)
    mine = folder.path("models", ModelReference("wall-motion", 3))
    mine.write_bytes(folder.path("models", ModelReference("wall-motion", 1)).read_bytes())
    with ResultStore(root) as store, pytest.raises(CorruptFileError, match="another version"):
        store.kept_model("wall-motion", 3)
    mine.unlink()
    with ResultStore(root) as store, pytest.raises(LostFileError, match="wall-motion@3 is lost"):
        store.kept_model("wall-motion", 3)


def test_files_that_are_none_of_ours_are_left_alone(root: Path) -> None:
    strange = [root / "models/wall-motion/4.h5.old", root / "models/Wall/1.h5", root / "models/x"]
    for path in strange:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    assert set(verify(root).orphans) == {str(path.relative_to(root)) for path in strange}
    rebuild(root)
    assert all(path.read_text() == "mine" for path in strange)


def test_a_model_comes_back_as_it_was(model: Model, tmp_path: Path) -> None:
    image = model_to_hdf5(model)
    again = model_from_hdf5(image)
    assert again.id == model.id
    assert model_to_hdf5(again) == image
    with ResultStore(tmp_path) as store:
        record = store.put_model(replace(model, name="mine"))
        assert record.classes == model.classes
        assert record.parameters == model.signature_parameters
        found = store.model("mine")
        assert (found.name, found.id) == ("mine", record.id)
        kept = read_kept_model(store.model_path("mine", 1))
        assert kept.card == json.loads(json.dumps(kept_model(model).card))


def test_a_file_that_holds_another_model_is_refused(model: Model) -> None:
    image = model_to_hdf5(model)
    kept = kept_model(model)
    wrong = model_to_hdf5(replace(kept, record=replace(kept.record, id="0" * 64)))
    assert model_from_hdf5(image).id == model.id
    with pytest.raises(CorruptFileError, match="does not contain the model"):
        model_from_hdf5(wrong)
    with pytest.raises(CorruptFileError):
        model_from_hdf5(image[:-1])


def a_norm(seed: int, name: str = "volunteers") -> Norm:
    rng = np.random.default_rng(seed)
    readings = [replace(drawn(rng, k), sequence_id=f"{seed}-{k}") for k in range(9)]
    return replace(norm_of(readings), name=name)


@pytest.fixture
def root_of_norms(tmp_path: Path) -> Path:
    with ResultStore(tmp_path / "store") as store:
        assert store.put_norm(a_norm(1))
        assert not store.put_norm(a_norm(1))
    return tmp_path / "store"


def test_a_name_is_one_norms_until_it_is_deleted(root_of_norms: Path) -> None:
    with ResultStore(root_of_norms) as store:
        assert store.norms() == ("volunteers",)
        assert store.norm("volunteers").id == a_norm(1).id
        with pytest.raises(ParameterError, match="another norm named 'volunteers'"):
            store.put_norm(a_norm(2))
        store.delete_norm("volunteers")
        with pytest.raises(NotFoundError, match="no norm named 'volunteers'"):
            store.delete_norm("volunteers")
        assert store.put_norm(a_norm(2))
        assert store.norm("volunteers").id == a_norm(2).id
        for name in ("other", "../volunteers", "", "Volunteers"):
            with pytest.raises(NotFoundError):
                store.norm(name)
        with pytest.raises(ParameterError):
            store.put_norm(a_norm(1, "Not A Name"))
    assert verify(root_of_norms).is_sound


def test_a_damaged_norm_is_found_and_put_again(root_of_norms: Path) -> None:
    path = root_of_norms / "norms" / "volunteers.h5"
    whole = path.read_bytes()
    path.write_bytes(whole[:-9])
    assert [fault.file for fault in verify(root_of_norms).faults] == ["norms/volunteers.h5"]
    with ResultStore(root_of_norms) as store:
        assert store.put_norm(a_norm(1))
    path.rename(path.with_stem("renamed"))
    (fault,) = verify(root_of_norms).faults
    assert "another name" in fault.problem
    (root_of_norms / "norms" / "notes.txt").write_text("mine")
    assert "norms/notes.txt" in verify(root_of_norms).orphans


def test_a_copy_has_norms_and_learns_of_their_deletion(root_of_norms: Path, tmp_path: Path) -> None:
    copy, older = tmp_path / "copy", tmp_path / "older"
    backup(root_of_norms, copy)
    shutil.copytree(copy / "norms", older)
    with ResultStore(root_of_norms) as store:
        store.delete_norm("volunteers")
    assert backup(root_of_norms, copy).missing == ()
    assert not (copy / "norms" / "volunteers.h5").exists()
    # Older files that are laid over the folder bring nothing back.
    shutil.copytree(older, root_of_norms / "norms", dirs_exist_ok=True)
    rebuild(root_of_norms)
    with ResultStore(root_of_norms) as store:
        assert store.norms() == ()
        store.put_norm(a_norm(3))
    backup(root_of_norms, copy)
    (root_of_norms / "norms" / "volunteers.h5").unlink()
    assert backup(root_of_norms, copy).missing == ("norms/volunteers.h5",)
    shutil.rmtree(root_of_norms)
    restore(copy, root_of_norms)
    with ResultStore(root_of_norms) as store:
        assert store.norm("volunteers").id == a_norm(3).id
