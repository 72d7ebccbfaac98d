"""The store against a naive twin that keeps everything in dictionaries."""

from __future__ import annotations

import os
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from store_samples import (
    KEY,
    MODEL,
    assert_same,
    put_classification,
    sample_classification,
    sample_sequence,
    sample_signature,
    tree,
)

from modalmotion.classification.answer import Classification
from modalmotion.errors import NotFoundError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature, SignatureParameters
from modalmotion.store import UNSET, ResultStore, rebuild, verify

SEQUENCES = [sample_sequence(number, n_frames=2) for number in range(5)]
SIGNATURES = {(s.id, m): sample_signature(s, m) for s in SEQUENCES for m in (1, 4)}
NAMES = st.sampled_from([None, "a", "b"])
WHICH = st.integers(0, len(SEQUENCES) - 1)
MODES = st.sampled_from([1, 4])


@dataclass
class Kept:
    vertices: MeshSequence | None
    subject: str | None
    label: str | None
    signatures: dict[str, ModalSignature] = field(default_factory=dict)
    classifications: dict[tuple[str, str], Classification] = field(default_factory=dict)


class StoreAndTwin(RuleBasedStateMachine):
    """Both are told the same; the twin keeps sequences in the order in which they came."""

    def __init__(self) -> None:
        super().__init__()
        self.root = Path(tempfile.mkdtemp())
        self.twin: dict[str, Kept] = {}
        self.keep = True
        self.store = ResultStore(self.root)

    def teardown(self) -> None:
        self.store.close()
        try:
            assert verify(self.root).is_sound
        finally:
            shutil.rmtree(self.root)

    @initialize()
    def open(self) -> None:
        self.store.open()

    @rule(which=WHICH, subject=NAMES, label=NAMES)
    def put(self, which: int, subject: str | None, label: str | None) -> None:
        sequence = SEQUENCES[which]
        kept = self.twin.get(sequence.id)
        assert self.store.put_sequence(sequence, subject=subject, label=label) is (kept is None)
        if kept is None:
            kept = self.twin[sequence.id] = Kept(None, subject, label)
        if self.keep:
            kept.vertices = sequence

    @rule(which=WHICH, modes=MODES)
    def put_signature(self, which: int, modes: int) -> None:
        signature = SIGNATURES[SEQUENCES[which].id, modes]
        kept = self.twin.get(signature.sequence_id)
        if kept is None:
            with pytest.raises(NotFoundError):
                self.store.put_signature(signature)
        else:
            self.store.put_signature(signature)
            kept.signatures[signature.parameters.key] = signature

    @rule(which=WHICH)
    def put_classification(self, which: int) -> None:
        classification = sample_classification(SEQUENCES[which].id)
        kept = self.twin.get(classification.sequence_id)
        if kept is None:
            with pytest.raises(NotFoundError):
                put_classification(self.store, classification, KEY)
        else:
            put_classification(self.store, classification, KEY)
            kept.classifications[MODEL, KEY] = classification

    @rule(which=WHICH, subject=NAMES | st.just(UNSET), label=NAMES | st.just(UNSET))
    def update(self, which: int, subject: Any, label: Any) -> None:
        name = SEQUENCES[which].id
        kept = self.twin.get(name)
        if kept is None:
            with pytest.raises(NotFoundError):
                self.store.update_sequence(name, subject=subject, label=label)
            return
        if subject is not UNSET:
            kept.subject = subject
        if label is not UNSET:
            kept.label = label
        record = self.store.update_sequence(name, subject=subject, label=label)
        assert (record.subject, record.label) == (kept.subject, kept.label)

    @rule(which=WHICH)
    def delete(self, which: int) -> None:
        name = SEQUENCES[which].id
        if self.twin.pop(name, None) is None:
            with pytest.raises(NotFoundError):
                self.store.delete_sequence(name)
        else:
            self.store.delete_sequence(name)

    @rule(keep=st.booleans(), in_order=st.booleans())
    def close_and_open(self, keep: bool, in_order: bool) -> None:
        self.keep = keep
        self.store._is_clean = in_order
        self.store.close()
        self.store = ResultStore(self.root, keep_uploads=keep).open()

    @precondition(lambda self: bool(self.twin))
    @rule(index_survives=st.booleans())
    def rebuild(self, index_survives: bool) -> None:
        before = self.store.list_sequences()
        self.store.close()
        if not index_survives:
            (self.root / "index.sqlite").unlink()
        found = rebuild(self.root)
        assert (found.restored, found.damaged, found.orphans) == ((), (), ())
        self.store.open()
        assert self.store.list_sequences() == before

    @rule(subject=NAMES, label=NAMES, limit=st.integers(1, 6))
    def list_pages(self, subject: str | None, label: str | None, limit: int) -> None:
        found: list[str] = []
        cursor = None
        while True:
            page = self.store.list_sequences(
                subject=subject, label=label, limit=limit, cursor=cursor
            )
            found += [record.id for record in page.records]
            cursor = page.cursor
            if cursor is None:
                break
        newest_first = reversed(self.twin.items())
        assert found == [
            name
            for name, kept in newest_first
            if subject in (None, kept.subject) and label in (None, kept.label)
        ]

    @invariant()
    def both_give_the_same(self) -> None:
        if self.store._index is None:
            return
        for sequence in SEQUENCES:
            kept = self.twin.get(sequence.id)
            assert self.store.has_sequence(sequence.id) is (kept is not None)
            if kept is None:
                continue
            record = self.store.sequence_record(sequence.id)
            assert (record.subject, record.label) == (kept.subject, kept.label)
            if kept.vertices is None:
                with pytest.raises(NotFoundError, match="not kept"):
                    self.store.sequence(sequence.id)
            else:
                assert_same(self.store.sequence(sequence.id), kept.vertices)
            assert set(self.store.signatures(sequence.id)) == set(kept.signatures)
            for key, signature in kept.signatures.items():
                assert_same(self.store.signature(sequence.id, key), signature)
            assert set(self.store.classifications(sequence.id)) == set(kept.classifications)
            for (model, key), classification in kept.classifications.items():
                found = self.store.classification(sequence.id, model, key)
                assert_same(found, classification)
        n_files = sum(
            1 + (kept.vertices is not None) + len(kept.signatures) + len(kept.classifications)
            for kept in self.twin.values()
        )
        assert len(tree(self.root)) == n_files


def test_both_keys_differ() -> None:
    assert SignatureParameters(modes=1).key != SignatureParameters(modes=4).key


TestStoreAndTwin = StoreAndTwin.TestCase
TestStoreAndTwin.settings = settings(
    max_examples=10 * int(os.environ.get("SOAK", "1")),
    stateful_step_count=20,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
