"""A store that an older version wrote: refused by name, taken by `rebuild`, which says what not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from classify_samples import small_model
from click.testing import CliRunner
from damaged_stores import N, four_kept
from guest_table import visits
from older_stores import (
    header,
    old_classification,
    old_file,
    old_kind,
    old_model,
    old_sequence,
    old_signature,
    set_index_version,
)
from sealed_files import changed
from store_samples import (
    KEY,
    MODEL,
    assert_same,
    sample_classification,
    sample_sequence,
    sample_signature,
    tree,
)

from modalmotion.classification.model.hdf5 import (
    kept_model,
    model_to_hdf5,
    numbered,
)
from modalmotion.cli.store_commands import store as commands
from modalmotion.errors import CorruptFileError, OlderFileError
from modalmotion.facts import NO_FACTS
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import ResultStore, classification_from_hdf5, rebuild, verify
from modalmotion.store.care.older_forms import OLD_RECORD
from modalmotion.store.folder import Folder, ResultName
from modalmotion.store.record import record_values


def classification_of(root: Path, number: int) -> Path:
    name = ResultName("classification", sample_sequence(number).id, MODEL, KEY)
    return Folder(root).result(name)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A store of 0.1.0: its classifications and its index are of older forms."""
    root = four_kept(tmp_path / "store")
    for number in range(N):
        found = sample_classification(sample_sequence(number).id)
        classification_of(root, number).write_bytes(old_classification(found, KEY))
    set_index_version(root, 1)
    return root


def test_a_store_of_older_files_is_refused_with_the_remedy(root: Path) -> None:
    before = tree(root)
    for _ in range(2):
        with pytest.raises(OlderFileError) as caught:
            ResultStore(root).open()
        assert "modalmotion store rebuild FOLDER" in caught.value.remedy
    assert not verify(root).is_sound
    assert tree(root) == before


def test_older_files_are_refused_without_their_index_too(root: Path) -> None:
    (root / "index.sqlite").unlink()
    with pytest.raises(OlderFileError, match="version 1") as caught:
        ResultStore(root).open()
    assert "modalmotion store rebuild FOLDER" in caught.value.remedy
    assert rebuild(root).rewritten["classification"] == N
    ResultStore(root).open().close()


def test_an_older_file_is_refused_by_its_reader(root: Path) -> None:
    with pytest.raises(OlderFileError, match="version 1") as caught:
        classification_from_hdf5(classification_of(root, 0))
    assert caught.value.details == {"schema_version": 1, "known": 2}


def test_rebuild_takes_a_store_of_older_files(root: Path) -> None:
    found = rebuild(root)
    assert found.rewritten == {"classification": N}
    assert (found.refused, found.damaged, found.guests_lost) == ({}, (), False)
    assert verify(root).is_sound
    with ResultStore(root) as store:
        assert visits(store) == {1}
        for number in range(N):
            sequence = sample_sequence(number)
            expected = sample_classification(sequence.id)
            # Nothing was ruled out then: the set of all classes, which is always right.
            expected = replace(
                expected, class_set=expected.classes, coverage=1.0, flags=(), explanation=()
            )
            assert_same(store.classification(sequence.id, MODEL, KEY), expected)
            assert_same(store.signature(sequence.id, KEY), sample_signature(sequence))
            assert store.sequence_record(sequence.id).subject == f"P {number}"
    # There is nothing left to take.
    files = tree(root)
    assert rebuild(root).rewritten == {}
    assert tree(root) == files


@pytest.mark.parametrize("auto", [False, True])
def test_a_signature_of_version_4_gets_what_is_known_now(tmp_path: Path, auto: bool) -> None:
    root, sequence = tmp_path / "store", sample_sequence(1)
    parameters = SignatureParameters(auto=True) if auto else SignatureParameters(modes=4)
    new = modal_signature(sequence, parameters)
    assert (new.amplitude_deviations is not None) == auto
    with ResultStore(root) as store:
        store.put_sequence(sequence)
        store.put_signature(replace(new, amplitude_deviations=None))
    path = Folder(root).result(ResultName("signature", sequence.id, "", parameters.key))

    def older(file: h5py.File) -> None:
        file.attrs["schema_version"] = np.int64(4)

    path.write_bytes(changed(path.read_bytes(), older))
    assert rebuild(root).rewritten == {"signature": 1}
    with ResultStore(root) as store:
        again = store.signature(sequence.id, parameters.key)
    assert np.array_equal(again.amplitudes, new.amplitudes)
    assert (again.amplitude_deviations is not None) == auto


def test_what_cannot_be_taken_is_named_and_left_alone(root: Path) -> None:
    path = classification_of(root, 2)
    attributes = header("classification", 1, model="m", sequence_id="0", model_id="0")
    path.write_bytes(old_file(attributes, {"classes": ["a", "b"]}))
    before = path.read_bytes()
    name = Folder(root).short(path)
    found = rebuild(root)
    assert found.rewritten == {"classification": N - 1}
    assert list(found.refused) == [name]
    assert found.damaged == ()
    assert path.read_bytes() == before
    with ResultStore(root) as store:
        assert store.classifications(sample_sequence(2).id) == ()
        assert len(store.classifications(sample_sequence(1).id)) == 1
    text = CliRunner().invoke(commands, ["rebuild", str(root)]).output
    assert f"{name}: of an older version, and could not be taken" in text


def test_the_command_says_what_was_rewritten(root: Path) -> None:
    text = CliRunner().invoke(commands, ["rebuild", str(root)]).output
    assert f"{N} classification files of an older version rewritten" in text
    assert f"{N} sequences, {3 * N} results" in text


def test_a_rewriting_that_stops_half_way_goes_on(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Path] = []

    def stop(path: Path, image: bytes) -> None:
        if written:
            raise KeyboardInterrupt
        path.write_bytes(image)
        written.append(path)

    with monkeypatch.context() as patch:
        patch.setattr("modalmotion.store.care.older_forms.write_atomic", stop)
        with pytest.raises(KeyboardInterrupt):
            rebuild(root)
    with pytest.raises(OlderFileError):
        ResultStore(root).open()
    assert rebuild(root).rewritten == {"classification": N - 1}
    assert verify(root).is_sound


def models_of(root: Path) -> Path:
    return root / "models" / "small"


def test_rebuild_takes_models_that_were_text(root: Path) -> None:
    model = old_kind(small_model())
    models_of(root).mkdir()
    (models_of(root) / "2.h5").write_bytes(old_model(model, 2))
    assert rebuild(root).rewritten == {"classification": N, "model": 1}
    assert verify(root).is_sound
    with ResultStore(root) as store:
        record = store.model_record("small")
        assert (record.version, record.id, record.training) == (2, model.id, "t")
        assert record.created == "2026-01-02T03:04:05.000006Z"
        again = store.model("small")
    assert again.card == model.card
    # The same file as a store of today's would hold.
    expected = numbered(kept_model(model, training="t"), 2, record.created)
    assert (models_of(root) / "2.h5").read_bytes() == model_to_hdf5(expected)


def test_a_model_that_cannot_be_taken_keeps_its_number(root: Path) -> None:
    models_of(root).mkdir()
    model = old_kind(small_model())
    other = replace(model, golden_probabilities=model.golden_probabilities + 1e-3)
    (models_of(root) / "1.h5").write_bytes(old_model(model, 1, machine=b"skops"))
    (models_of(root) / "2.h5").write_bytes(old_model(other, 2))
    found = rebuild(root)
    assert set(found.refused) == {"models/small/1.h5", "models/small/2.h5"}
    assert "Train it again" in found.refused["models/small/1.h5"]
    assert "golden batch" in found.refused["models/small/2.h5"]
    assert found.damaged == ()
    with ResultStore(root) as store:
        assert store.put_model(model).version == 3


def test_a_file_of_a_newer_version_is_not_older(root: Path) -> None:
    path = classification_of(root, 0)
    path.write_bytes(old_file(header("classification", 99), {}))
    with pytest.raises(CorruptFileError, match="version 99"):
        classification_from_hdf5(path)
    assert rebuild(root).damaged == (Folder(root).short(path),)


def test_sequences_and_their_records_get_facts_that_are_unknown(tmp_path: Path) -> None:
    sequence = replace(sample_sequence(0), times=np.array([0.0, 0.5, 0.75, 2.0]))
    root = tmp_path / "store"
    with ResultStore(root) as store:
        store.put_sequence(sequence, subject="P 1")
        record = store.sequence_record(sequence.id)
    folder = Folder(root)
    values = {n: v for n, v in record_values(record).items() if n not in ("facts", "span")}
    folder.record(sequence.id).write_bytes(OLD_RECORD.write(values))
    folder.upload(sequence.id).write_bytes(old_sequence(sequence))
    set_index_version(root, 1)
    with pytest.raises(OlderFileError):
        ResultStore(root).open()
    assert rebuild(root).rewritten == {"sequence": 1, "record": 1}
    assert verify(root).is_sound
    with ResultStore(root) as store:
        assert store.sequence_record(sequence.id) == record
        assert record.span == 2.0
        assert store.sequence(sequence.id).facts == NO_FACTS
        assert store.sequence(sequence.id).id == sequence.id


def test_signatures_whose_error_was_by_weight_alone_are_made_again(tmp_path: Path) -> None:
    root = tmp_path / "store"
    asked = SignatureParameters(tolerance=1.2)
    sequences = [sample_sequence(0), sample_sequence(1)]
    with ResultStore(root) as store:
        for sequence in sequences:
            store.put_sequence(sequence)
            store.put_signature(modal_signature(sequence, asked))
        record = Folder(root)
    for sequence in sequences:
        path = record.result(ResultName("signature", sequence.id, "", asked.key))
        path.write_bytes(old_signature(sequence.id, asked))
    record.upload(sequences[1].id).unlink()
    set_index_version(root, 1)
    with pytest.raises(OlderFileError):
        ResultStore(root).open()
    found = rebuild(root)
    assert found.rewritten == {"signature": 1}
    assert "send the sequence again" in str(found.refused)
    with ResultStore(root) as store:
        assert_same(
            store.signature(sequences[0].id, asked.key), modal_signature(sequences[0], asked)
        )
