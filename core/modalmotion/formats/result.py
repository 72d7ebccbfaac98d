"""Results of readers and parsers, and the protocol of parsers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.limits import ReadLimits
from modalmotion.mesh import NO_FACTS, Facts
from modalmotion.mesh.checks import FloatArray, given_up
from modalmotion.mesh.sequence import MeshSequence, in_time_order, mesh_sequence
from modalmotion.representation import shown

Source = Literal["file", "format", "caller"]
"""Origin of a fact: this file, the definition of its format, or the caller."""


@shown("sequence.n_frames", "sequence.n_vertices", "format", "sequence.unit", "ignored", "notes")
@dataclass(frozen=True)
class Reading:
    """A sequence, with the origin and the unused content of its file.

    Parameters
    ----------
    sequence : MeshSequence
    ignored : tuple of str
        Names of arrays and members that were not used.
    format : str
        Name of the file's format.
    coordinate_system : str or None
        Directions of the axes as the file names them ("LPS", "RAS", "Y up"); None if it does
        not. Positions are never turned.
    unit_from, times_from : {"file", "format", "caller"} or None
        Who states the unit and the times; None if they are unknown.
    notes : tuple of str
        Changes and assumptions of the reader.
    """

    sequence: MeshSequence
    ignored: tuple[str, ...] = ()
    format: str = "npz"
    coordinate_system: str | None = None
    unit_from: Source | None = None
    times_from: Source | None = None
    notes: tuple[str, ...] = ()


def reading_of(
    vertices: FloatArray,
    faces: NDArray[np.int64] | None,
    *,
    format: str,  # noqa: A002 - the name of the field
    grid: Any = None,
    topology: str | None = None,
    times: Any = None,
    unit: str | None = None,
    facts: Facts = NO_FACTS,
    unit_from: Source = "file",
    notes: Iterable[str] = (),
    **more: Any,
) -> Reading:
    """Make the sequence of what a reader found, its frames in the order of their times.

    Parameters
    ----------
    vertices : (frames, vertices, 3) float
        Its maker gives it up: see `given_up`.
    faces : (faces, 3) int64 or None
    format : str
    grid, topology, times, unit, facts
        As of `mesh_sequence`.
    unit_from : {"file", "format"}
    notes : iterable of str
    **more
        Further fields of the reading.

    Raises
    ------
    InputError
        If they form no sequence.
    """
    added: tuple[str, ...] = ()
    if times is not None and vertices.ndim == 3:
        vertices, times, added = in_time_order(vertices, times)
    sequence = mesh_sequence(
        given_up(vertices),
        faces,
        grid=grid,
        topology=topology,
        times=times,
        unit=unit,
        facts=facts,
    )
    return Reading(
        sequence,
        format=format,
        unit_from=None if sequence.unit is None else unit_from,
        times_from=None if sequence.times is None else "file",
        notes=(*notes, *added),
        **more,
    )


Parsed = tuple[dict[str, Any], dict[str, NDArray[Any]]]
"""Text and numbers by name, and arrays by name."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A parser's result.

    Parameters
    ----------
    info : dict
        Text and numbers.
    arrays : dict of ndarray
    """

    info: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


class Parser(Protocol):
    """Runs parsers on files: `ParserProcess`, or `ParserHere`."""

    @property
    def limits(self) -> ReadLimits:
        """Limits on a file."""

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file by the parser of that name."""


@dataclass(frozen=True)
class ParserOfFile:
    """A parser for what is inside one file, with that file's limits.

    Parameters
    ----------
    parser : Parser
    limits : ReadLimits
    """

    parser: Parser
    limits: ReadLimits

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file inside of it."""
        return self.parser.parse(task, data)
