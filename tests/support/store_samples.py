"""Things to keep in a store, made from numbers."""

from __future__ import annotations

import hashlib
import struct
import tempfile
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from modalmotion.classification.answer import (
    Classification,
    ModeContribution,
    classification_to_hdf5,
)
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes import ModeSet
from modalmotion.notes import Note
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.signature.parameters import parameters_as_json
from modalmotion.store import (
    KeptModel,
    ModelRecord,
    ResultStore,
    SequencePage,
    record_of,
    track_image,
    upload_image,
)
from modalmotion.store.deletion import TOMBSTONES
from modalmotion.template import Template
from modalmotion.tracking import Track

KEY = SignatureParameters().key
MODEL = hashlib.sha256(b"a model").hexdigest()


@cache
def sample_sequence(number: int, n_frames: int = 4) -> MeshSequence:
    """Small lattice that moves, another one for each number."""
    rng = np.random.default_rng([number, 7])
    positions = rng.normal(size=(n_frames, 5 * 6, 3))
    return mesh_sequence(positions, grid=(5, 6), topology="cup", unit="mm")


@cache
def sample_signature(sequence: MeshSequence, modes: int = 7) -> ModalSignature:
    return modal_signature(sequence, SignatureParameters(modes=modes))


def sample_classification(sequence_id: str, model_id: str = MODEL) -> Classification:
    return Classification(
        sequence_id=sequence_id,
        model="sample",
        model_id=model_id,
        label="normal",
        classes=("normal", "akinesia"),
        probabilities=np.array([0.75, 0.25]),
        class_set=("normal",),
        coverage=0.9,
        flags=(),
        explanation=(ModeContribution(("(0, 1, cos)", "(0, 1, sin)"), 1.25, 0.5, -0.75, "mm"),),
        notes=(Note("made_up", "made up"),),
        provenance={"modalmotion": "0"},
    )


def sample_model(
    number: int = 0, name: str = "wall-motion", training: str | None = None
) -> KeptModel:
    """A model whose arrays mean nothing, another one for each number."""
    record = ModelRecord(
        name=name,
        version=0,
        id=f"{number:064x}",
        classes=("normal", "akinesia"),
        parameters=SignatureParameters(modes=4 + number % 3),
        created="",
        training=training,
    )
    arrays = {"strangeness": np.full(100, number % 251, dtype=np.uint8)}
    texts = dict.fromkeys(("tables", "columns", "detector", "notes"))
    readable = {"parameters": parameters_as_json(record.parameters)}
    return KeptModel(
        record,
        {"accuracy": 0.9, "number": number},
        arrays,
        {**texts, "readable": readable},
    )


def assert_same(found: object, expected: object) -> None:
    """Assert that all fields are equal: arrays bit for bit, with their types."""
    assert type(found) is type(expected)
    if isinstance(expected, Template):
        # How it was placed is of the recording alone: in a file it counts as exact.
        assert isinstance(found, Template)
        found, expected = replace(found, placement=None), replace(expected, placement=None)
    if isinstance(expected, np.ndarray):
        assert isinstance(found, np.ndarray)
        assert (found.dtype, found.shape) == (expected.dtype, expected.shape)
        assert found.tobytes() == expected.tobytes()
    elif isinstance(expected, float):
        assert struct.pack("<d", found) == struct.pack("<d", expected)
    elif isinstance(expected, tuple):
        assert isinstance(found, tuple)
        for one, other in zip(found, expected, strict=True):
            assert_same(one, other)
    elif isinstance(expected, ModeSet | MappingProxyType) or not hasattr(
        expected, "__dataclass_fields__"
    ):
        assert found == expected
    else:
        for field in fields(expected):  # type: ignore[arg-type]
            assert_same(getattr(found, field.name), getattr(expected, field.name))


def tree(root: Path) -> dict[str, bytes]:
    """All files of a store but the lock, SQLite's and tombstones, with their content."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
        and not path.name.startswith(("index.sqlite", "lock"))
        and path.parent.parent.name != TOMBSTONES
    }


def all_pages(store: ResultStore, limit: int, **filters: Any) -> list[str]:
    """Ids of the lists' pages, one after another."""
    ids, cursor = [], None
    for _ in range(100):
        page: SequencePage = store.list_sequences(limit=limit, cursor=cursor, **filters)
        assert len(page.records) <= limit
        ids += [record.id for record in page.records]
        cursor = page.cursor
        if cursor is None:
            return ids
    raise AssertionError("the pages do not end")


def put_classification(store: ResultStore, classification: Classification, key: str) -> Path:
    """Keep a classification."""
    image = classification_to_hdf5(classification, parameters_key=key)
    ids = classification.sequence_id, classification.model_id
    return store.put_classification_image(image, *ids, key)


def put_track(store: ResultStore, track: Track, **names: str) -> bool:
    """Keep a track and its sequence; return whether it was not known before."""
    record = record_of(track.sequence, created="", has_upload=True)
    with tempfile.TemporaryDirectory() as folder:
        sequence, file = Path(folder) / "sequence.h5", Path(folder) / "track.h5"
        sequence.write_bytes(upload_image(track.sequence))
        file.write_bytes(track_image(track))
        return store.put_track_images(sequence, file, record, **names)[1]
