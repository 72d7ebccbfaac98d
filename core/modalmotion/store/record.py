"""Records: small files that describe sequences without their vertices."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import ParameterError
from modalmotion.mesh import NO_FACTS, Facts, facts_as_json, facts_from_json
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import is_readable, shown
from modalmotion.store.disk.sealed_json import JsonForm

FORM: Final = JsonForm(
    "sequence-record",
    3,
    "Run `modalmotion store rebuild`, which writes it anew from what else is known.",
)
LONGEST_NAME: Final = 200


class Unset(Enum):
    """An argument that was left out, where None has a meaning of its own."""

    UNSET = "unset"


UNSET: Final = Unset.UNSET


@shown("n_frames", "n_vertices", "n_faces", "topology", "unit", "name", "subject", "label", "id")
@dataclass(frozen=True)
class SequenceRecord:
    """All that the store knows of a sequence without reading its vertices.

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
    facts : Facts
        As stated now, and stored here alone: the file of its vertices has none, so
        that a correction, or the removal of what identifies a person, leaves nothing behind.
    span : float or None, s
        From the first time to the last; None if times are unknown.
    name : str or None
        What its owner calls it, such as the name of the file.
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
    facts: Facts = NO_FACTS
    span: float | None = None
    name: str | None = None


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
        facts=sequence.facts,
        span=sequence.span,
    )


def record_to_json(record: SequenceRecord) -> bytes:
    """Write a record as JSON that ends with the sha256 of the text before it."""
    return FORM.write(record_values(record))


def record_values(record: SequenceRecord) -> dict[str, Any]:
    """Values of a record by name, facts as JSON has them."""
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    return {**values, "facts": facts_as_json(record.facts)}


def read_record(path: Path) -> SequenceRecord:
    """Read a record.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged.
    StoreError
        If it was written by another version.
    """
    return record_from(FORM.read(path))


def record_from(values: dict[str, Any]) -> SequenceRecord:
    """Make a record of `record_values`, lists for tuples; without facts where there are none."""
    grid, facts = values["grid"], facts_from_json(values.get("facts", {}))
    return SequenceRecord(
        **{**values, "grid": None if grid is None else tuple(grid), "facts": facts}
    )


def require_name(name: str, text: str | None) -> str | None:
    """Check a name, a subject or a label.

    Raises
    ------
    ParameterError
        If it is too long, or not `is_readable`.
    """
    if text is None:
        return None
    if len(text) > LONGEST_NAME:
        raise ParameterError(
            f"The {name} has {len(text)} characters, more than {LONGEST_NAME}.",
            remedy="Use a short name.",
            details={"longest": LONGEST_NAME},
        )
    if not is_readable(text):
        raise ParameterError(
            f"The {name} {text[:40]!a} contains control characters, or was not sent in UTF-8.",
            remedy="Use letters, digits, signs and spaces.",
        )
    return text
