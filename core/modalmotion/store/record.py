"""What is known of a sequence besides its vertices, in a small file of its own."""

from __future__ import annotations

import hashlib
import json
import unicodedata
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import CorruptFileError, ParameterError, StoreError
from modalmotion.hdf5.sealed import read_file
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown

SCHEMA: Final = "modalmotion.sequence-record"
SCHEMA_VERSION: Final = 1
LONGEST_NAME: Final = 200


@shown("n_frames", "n_vertices", "n_faces", "topology", "unit", "subject", "label", "id")
@dataclass(frozen=True)
class SequenceRecord:
    """What the store knows of a sequence without reading its vertices.

    Parameters
    ----------
    id : str
        sha256 of the content, in hex.
    n_frames, n_vertices, n_faces : int
    topology : str or None
        As stated by the sender.
    grid : tuple of int or None
    unit : str or None
        Of lengths.
    has_times : bool
    subject, label : str or None
        Whose it is, and what it shows, as the user says.
    created : str
        When it was first put, UTC, ISO 8601 with microseconds.
    has_upload : bool
        Whether the vertices are kept.
    """

    id: str
    n_frames: int
    n_vertices: int
    n_faces: int
    topology: str | None
    grid: tuple[int, ...] | None
    unit: str | None
    has_times: bool
    subject: str | None
    label: str | None
    created: str
    has_upload: bool


def record_of(
    sequence: MeshSequence,
    *,
    created: str,
    has_upload: bool,
    subject: str | None = None,
    label: str | None = None,
) -> SequenceRecord:
    """Record of a sequence."""
    return SequenceRecord(
        id=sequence.id,
        n_frames=sequence.n_frames,
        n_vertices=sequence.n_vertices,
        n_faces=len(sequence.faces),
        topology=None if sequence.topology is None else sequence.topology.name,
        grid=sequence.grid,
        unit=sequence.unit,
        has_times=sequence.times is not None,
        subject=subject,
        label=label,
        created=created,
        has_upload=has_upload,
    )


def record_to_json(record: SequenceRecord) -> bytes:
    """Write a record as JSON that ends with the sha256 of what stands before."""
    content = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION, "record": asdict(record)}
    return json.dumps({**content, "sha256": _digest(content)}, indent=1).encode()


def read_record(path: Path) -> SequenceRecord:
    """Read a record.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged.
    StoreError
        If it was written by a newer version.
    """
    try:
        content: dict[str, Any] = json.loads(read_file(path))
        is_whole = content.pop("sha256") == _digest(content)
        schema, version = content["schema"], content["schema_version"]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _damaged(path, str(error)) from error
    if not is_whole:
        raise _damaged(path, "its fields do not have the sha256 that it states")
    # Not called damaged from here on, for what is damaged may be written anew.
    if (schema, version) != (SCHEMA, SCHEMA_VERSION):
        raise StoreError(
            f"'{path.name}' has the schema {str(schema)[:40]!r}, version {str(version)[:10]}, "
            f"not {SCHEMA!r}, version {SCHEMA_VERSION}.",
            remedy="Read it with the modalmotion that wrote it, or a newer one.",
        )
    fields = content["record"]
    grid = fields["grid"]
    return SequenceRecord(**{**fields, "grid": None if grid is None else tuple(grid)})


def require_name(name: str, text: str | None) -> str | None:
    """Check a subject or a label.

    Raises
    ------
    ParameterError
        If it is too long, or no text that can be kept.
    """
    if text is None:
        return None
    if len(text) > LONGEST_NAME:
        raise ParameterError(
            f"The {name} has {len(text)} characters, more than {LONGEST_NAME}.",
            remedy="Use a short name.",
            details={"longest": LONGEST_NAME},
        )
    if any(unicodedata.category(character) in ("Cc", "Cs") for character in text):
        raise ParameterError(
            f"The {name} {text[:40]!r} holds control characters.",
            remedy="Use letters, digits, signs and spaces.",
        )
    return text


def _damaged(path: Path, reason: str) -> CorruptFileError:
    return CorruptFileError(
        f"The record '{path.name}' is damaged ({reason[:100]}).",
        remedy="Run `modalmotion store rebuild`, which writes it anew from what else is known.",
    )


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
