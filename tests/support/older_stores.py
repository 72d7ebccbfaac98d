"""Files as version 0.1.0 wrote them, by h5py alone, and a store that is made of them."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import sqlite3
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.answer.classification import Classification
from modalmotion.mesh.sequence import MeshSequence

INTENDED_USE = "Description of surface motion."


def old_file(
    attributes: dict[str, str | int],
    datasets: dict[str, Any],
    lists: dict[str, NDArray[np.int64]] | None = None,
) -> bytes:
    """Sealed HDF5 image: text as fixed-length strings, anything but an array as JSON."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for name, value in attributes.items():
            file.attrs[name] = np.bytes_(value) if isinstance(value, str) else np.int64(value)
        for name, numbers in (lists or {}).items():
            file.attrs[name] = numbers
        for name, value in datasets.items():
            is_array = isinstance(value, np.ndarray)
            file[name] = value if is_array else np.bytes_(json.dumps(value))
    image = buffer.getvalue()
    return image + f"\nmodalmotion sha256 {hashlib.sha256(image).hexdigest()}\n".encode()


def header(kind: str, version: int, **more: str | int) -> dict[str, str | int]:
    return {
        "schema": f"modalmotion.{kind}",
        "schema_version": version,
        "kind": kind,
        "intended_use": INTENDED_USE,
        **more,
    }


def old_classification(found: Classification, key: str) -> bytes:
    """Version 1: without class sets, flags and explanations."""
    attributes = header(
        "classification",
        1,
        model=found.model,
        sequence_id=found.sequence_id,
        model_id=found.model_id,
        parameters_key=key,
    )
    texts = {name: getattr(found, name) for name in ("classes", "label", "notes", "provenance")}
    return old_file(attributes, {"probabilities": found.probabilities, **texts})


def old_sequence(sequence: MeshSequence) -> bytes:
    """Version 1: without facts. A lattice with times and a unit."""
    assert sequence.topology is not None
    attributes = header(
        "sequence",
        1,
        unit=str(sequence.unit),
        topology=sequence.topology.name,
        sequence_id=sequence.id,
    )
    grid = np.array(sequence.grid)
    arrays = {name: getattr(sequence, name) for name in ("vertices", "faces", "times")}
    return old_file(attributes, arrays, {"grid": grid})


def set_index_version(root: Path, version: int) -> None:
    """Let the index of a store say that it is of another version."""
    with contextlib.closing(sqlite3.connect(root / "index.sqlite")) as connection:
        for column in ("facts", "span"):
            connection.execute(f"ALTER TABLE sequences DROP COLUMN {column}")
        connection.execute(f"PRAGMA user_version = {version}")
