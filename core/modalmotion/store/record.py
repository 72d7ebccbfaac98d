"""Records: small files that describe sequences without their vertices."""

from __future__ import annotations

import unicodedata
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Final

from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.store.disk.sealed_json import JsonForm

FORM: Final = JsonForm(
    "sequence-record",
    1,
    "Run `modalmotion store rebuild`, which writes it anew from what else is known.",
)
LONGEST_NAME: Final = 200


class Unset(Enum):
    """An argument that was left out, where None has a meaning of its own."""

    UNSET = "unset"


UNSET: Final = Unset.UNSET


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
    return FORM.write(asdict(record))


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
    fields = FORM.read(path)
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
