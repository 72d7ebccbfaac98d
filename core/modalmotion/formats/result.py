"""Result of a reader: a sequence with its origin and notes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown

Source = Literal["file", "format", "caller"]
"""Origin of a fact: this file, the definition of its format, or the caller."""


@shown("sequence.n_frames", "sequence.n_vertices", "format", "sequence.unit", "ignored", "notes")
@dataclass(frozen=True)
class Reading:
    """A sequence and what its file held besides.

    Parameters
    ----------
    sequence : MeshSequence
    ignored : tuple of str
        Names of arrays and members that were not used.
    format : str
        Name of the format that was read.
    coordinate_system : str or None
        Directions of the axes as the file names them ("LPS", "RAS", "Y up"); None where it is
        silent. Positions are never turned.
    unit_from, times_from : {"file", "format", "caller"} or None
        Who states the unit and the times; None where they are unknown.
    notes : tuple of str
        What was done on the way that a user should know.
    """

    sequence: MeshSequence
    ignored: tuple[str, ...] = ()
    format: str = "npz"
    coordinate_system: str | None = None
    unit_from: Source | None = None
    times_from: Source | None = None
    notes: tuple[str, ...] = ()
