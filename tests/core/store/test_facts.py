"""Facts in a store: in the record alone, changed there, and part of keys where they are read."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from facts_samples import FACTS
from hypothesis import given
from numpy.typing import NDArray
from store_samples import sample_sequence

from modalmotion import Facts, MeshSequence, NotFoundError, ParameterError, modal_signature
from modalmotion.mesh import NO_FACTS, facts_patched
from modalmotion.mesh.sequence import sequence_from_hdf5
from modalmotion.signature.hdf5 import signature_from_hdf5
from modalmotion.store import ResultStore, rebuild, verify
from modalmotion.store.folders import record_from, record_of, record_values

STATED = Facts(
    tracking="normal_displacement",
    period=2.0,
    landmarks={"apex": 3},
    covariates={"age": 61, "w": "unmistakable"},
)


@pytest.fixture
def sequence() -> MeshSequence:
    """A mesh, on which a landmark is read."""
    lattice = sample_sequence(5)
    faces = [(a, a + 1, a + 6) for a in range(23)] + [(a + 1, a + 7, a + 6) for a in range(23)]
    whole = MeshSequence(lattice.vertices, np.array(faces), unit="mm")
    return whole.with_facts(STATED)


def test_a_record_keeps_facts_and_the_file_of_vertices_has_none(
    tmp_path: Path, sequence: MeshSequence
) -> None:
    with ResultStore(tmp_path) as store:
        assert store.put_sequence(sequence)
        assert store.sequence(sequence.id).facts == STATED
        assert store.list_sequences().records[0].facts == STATED
        assert sequence_from_hdf5(store.sequence_path(sequence.id)).facts == NO_FACTS
    with ResultStore(tmp_path) as store:
        assert store.sequence_record(sequence.id).facts == STATED
    (tmp_path / "index.sqlite").unlink()
    rebuild(tmp_path)
    assert verify(tmp_path).is_sound
    with ResultStore(tmp_path) as store:
        assert store.sequence_record(sequence.id).facts == STATED


def test_what_is_taken_away_is_nowhere_in_the_folder(
    tmp_path: Path, sequence: MeshSequence
) -> None:
    change = partial(facts_patched, changes={"covariates": None})
    with ResultStore(tmp_path) as store:
        store.put_sequence(sequence)
        store.put_signature(modal_signature(store.sequence(sequence.id)))
        assert store.update_sequence(sequence.id, change=change).facts == replace(
            STATED, covariates={}
        )
    for path in tmp_path.rglob("*"):
        assert not path.is_file() or b"unmistakable" not in path.read_bytes()


def test_a_known_sequence_keeps_its_facts(tmp_path: Path, sequence: MeshSequence) -> None:
    with ResultStore(tmp_path) as store:
        store.put_sequence(sequence)
        assert not store.put_sequence(sequence.with_facts(Facts(tracking="material")))
        assert store.sequence_record(sequence.id).facts == STATED


def test_a_change_that_contradicts_the_arrays_is_refused(
    tmp_path: Path, sequence: MeshSequence
) -> None:
    times: NDArray[np.float64] = np.arange(4, dtype=np.float64)
    timed = replace(sequence, times=times, facts=NO_FACTS)
    with ResultStore(tmp_path) as store:
        store.put_sequence(timed)
        for facts in (Facts(period=2.0), Facts(landmarks={"apex": 30})):
            with pytest.raises(ParameterError):
                store.update_sequence(timed.id, change=facts.over)
        assert store.sequence_record(timed.id).facts == NO_FACTS
        with pytest.raises(NotFoundError):
            store.update_sequence("0" * 64, change=STATED.over)


def test_results_are_missed_after_a_change_of_what_they_read_and_of_nothing_else(
    tmp_path: Path, sequence: MeshSequence
) -> None:
    with ResultStore(tmp_path) as store:
        store.put_sequence(sequence)
        made = modal_signature(store.sequence(sequence.id))
        path = store.put_signature(made)
        assert signature_from_hdf5(path).facts == NO_FACTS

        changed = store.update_sequence(sequence.id, change=Facts(tracking="material").over)
        key = made.parameters.key
        assert modal_signature(store.sequence(sequence.id)).parameters.key == key
        assert store.signature(sequence.id, key).facts == changed.facts

        store.update_sequence(sequence.id, change=Facts(landmarks={"apex": 4}).over)
        other = modal_signature(store.sequence(sequence.id))
        assert other.parameters.key != key
        with pytest.raises(NotFoundError):
            store.signature(sequence.id, other.parameters.key)
        # Back again, it is found again.
        store.update_sequence(sequence.id, change=Facts(landmarks={"apex": 3}).over)
        assert modal_signature(store.sequence(sequence.id)).parameters.key == key
        assert store.signatures(sequence.id) == (key,)


@given(FACTS)
def test_facts_come_back_from_a_record(facts: Facts) -> None:
    record = record_of(sample_sequence(1).with_facts(facts), created="", has_upload=True)
    assert record_from(record_values(record)) == record
