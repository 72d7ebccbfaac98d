"""Files as version 0.1.0 wrote them, by h5py alone, and a store that is made of them."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from sealed_files import sealed

from modalmotion.choice.parameters import SignatureParameters, parameters_as_json
from modalmotion.classification import Classification, Model
from modalmotion.classification.features import FeatureReader
from modalmotion.classification.model.domain import of_kind_alone
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.store.index.schema import SEQUENCE_COLUMNS

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
    return sealed(buffer.getvalue())


def header(kind: str, schema_version: int, /, **more: str | int) -> dict[str, str | int]:
    return {
        "schema": f"modalmotion.{kind}",
        "schema_version": schema_version,
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


def old_signature(sequence_id: str, parameters: SignatureParameters) -> bytes:
    """Version 1, of which the rewriting reads what was asked: its errors were by weight alone."""
    attributes = header("signature", 1, sequence_id=sequence_id, parameters_key=parameters.key)
    return old_file(attributes, {"parameters": parameters_as_json(parameters)})


def old_kind(model: Model) -> Model:
    """Give a model as older ones were: of one choice of features, which its domain reads too."""
    member = replace(model.members[0], weight=1.0)
    values = {name: getattr(member.reader, name) for name in (*OLD_READER, "typical")}
    reader = FeatureReader(**values)
    known = model.domain
    domain = of_kind_alone(
        *(reader, known.means, known.whitening, known.limit),
        least_motion=known.least_motion,
        least_smooth=known.least_smooth,
    )
    d = len(member.columns)
    one = replace(
        model,
        members=(replace(member, reader=reader),),
        temperature=1.0,
        domain=domain,
        golden_features=model.golden_features[:, :d],
        cross_validation=None,
    )
    return replace(one, golden_probabilities=one.probabilities(one.golden_features))


OLD_READER = ("has_axis", "is_cycle", "n_harmonics", "walls", "adds_modes", "is_brief")


def old_model(model: Model, version: int, *, machine: bytes = b"", training: str = "t") -> bytes:
    """Version 1: JSON text, with arrays in base64, in a dataset of bytes."""
    (member,) = model.members
    blend, domain, reader = member.blend, model.domain, member.reader
    stored = {
        "schema": 4,
        "id": model.id,
        "name": model.name,
        "classes": list(model.classes),
        "topologies": list(model.readable.topologies),
        "n_modes": model.readable.n_modes,
        "connectivity_id": model.readable.connectivity_id,
        "parameters": model.signature_parameters.as_plain(),
        "reader": {
            **{name: getattr(reader, name) for name in OLD_READER},
            "typical": None
            if reader.typical is None
            else _packed(np.stack([reader.typical.real, reader.typical.imag])),
        },
        "columns": [[c.name, list(c.modes), c.power] for c in model.columns],
        "centre": _packed(blend.centre),
        "scale": _packed(blend.scale),
        "scorers": [_plain(scorer) for scorer in blend.scorers],
        "temperature": blend.temperature,
        "machine": base64.b64encode(machine).decode(),
        # It read what the model did, and checked nothing else.
        "domain": {
            "means": _packed(domain.means),
            "whitening": _packed(domain.whitening),
            "limit": domain.limit,
            "least_motion": domain.least_motion,
            "least_smooth": domain.least_smooth,
        },
        "calibration": [_packed(scores) for scores in model.calibration.scores],
        "golden_features": _packed(model.golden_features),
        "golden_probabilities": _packed(model.golden_probabilities),
        "notes": model.notes,
        "card": model.card.as_json(),
    }
    attributes = header("model", 1, model=model.name, version=version, model_id=model.id)
    datasets = {
        "contents": np.frombuffer(json.dumps(stored).encode(), dtype=np.uint8),
        "classes": model.classes,
        "parameters": parameters_as_json(model.signature_parameters),
        "card": stored["card"],
        "origin": {"created": "2026-01-02T03:04:05.000006Z", "training": training},
    }
    return old_file(attributes, datasets)


def _packed(array: np.ndarray[Any, Any]) -> dict[str, Any]:
    data = np.ascontiguousarray(array, dtype="<f8").tobytes()
    return {"shape": list(array.shape), "float64": base64.b64encode(data).decode()}


def _plain(value: Any) -> dict[str, Any]:
    fields = {name: getattr(value, name) for name in value.__dataclass_fields__}
    return {k: _packed(v) if isinstance(v, np.ndarray) else v for k, v in fields.items()}


_SEQUENCES_OF_2 = """CREATE TABLE older (
    id TEXT PRIMARY KEY, n_frames INTEGER NOT NULL, n_vertices INTEGER NOT NULL,
    n_faces INTEGER NOT NULL, topology TEXT, grid TEXT, unit TEXT,
    has_times INTEGER NOT NULL, subject TEXT, label TEXT, created TEXT NOT NULL,
    has_upload INTEGER NOT NULL, facts TEXT NOT NULL DEFAULT '{}', span REAL
) WITHOUT ROWID"""
_INDICES_OF_2 = {
    "time": "created, id",
    "subject": "subject, created, id",
    "label": "label, created, id",
    "both": "subject, label, created, id",
}
_TRIGGERS_SINCE_2 = (
    *("a_sequence_came", "a_sequence_went", "a_result_came", "a_result_went"),
    *("a_track_came", "a_track_went"),
)


def set_index_version(root: Path, version: int) -> None:
    """Give the index of a store the form of version 1 or 2, with all its rows."""
    with contextlib.closing(sqlite3.connect(root / "index.sqlite")) as connection:
        for name in _TRIGGERS_SINCE_2:
            connection.execute(f"DROP TRIGGER {name}")
        connection.execute("DROP TABLE counts")
        connection.execute(_SEQUENCES_OF_2)
        connection.execute(
            f"INSERT INTO older SELECT {SEQUENCE_COLUMNS} FROM sequences"  # noqa: S608 (constants)
        )
        connection.execute("DROP TABLE sequences")
        connection.execute("ALTER TABLE older RENAME TO sequences")
        for name, columns in _INDICES_OF_2.items():
            connection.execute(f"CREATE INDEX sequences_by_{name} ON sequences ({columns})")
        for column in ("facts", "span") if version == 1 else ():
            connection.execute(f"ALTER TABLE sequences DROP COLUMN {column}")
        connection.execute(f"PRAGMA user_version = {version}")
        connection.commit()
