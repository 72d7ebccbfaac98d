"""What a caller states beside a file, what is read from it, and the protocol of parsers."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np

from modalmotion import errors, mesh
from modalmotion.formats.detect import Format
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh import checks
from modalmotion.mesh.sequence import MeshSequence, in_time_order, mesh_sequence
from modalmotion.modes.topologies import Topology
from modalmotion.notes import Note
from modalmotion.representation import Array, FloatArray, Ints, shown

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
    notes : tuple of Note
        Changes and assumptions of the reader.
    """

    sequence: MeshSequence
    ignored: tuple[str, ...] = ()
    format: str = "npz"
    coordinate_system: str | None = None
    unit_from: Source | None = None
    times_from: Source | None = None
    notes: tuple[Note, ...] = ()


def reading_of(
    vertices: FloatArray,
    faces: Ints | None,
    *,
    format: str,  # noqa: A002 - the name of the field
    grid: Any = None,
    topology: str | None = None,
    times: Any = None,
    unit: str | None = None,
    facts: mesh.Facts = mesh.NO_FACTS,
    unit_from: Source = "file",
    notes: Iterable[Note] = (),
    ignored: Iterable[str] = (),
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
    notes : iterable of Note
    ignored : iterable of str
        Names in the file. Half a character of UTF-16, which nothing can write, becomes "?".
    **more
        Further fields of the reading.

    Raises
    ------
    InputError
        If they form no sequence.
    """
    added: tuple[Note, ...] = ()
    if times is not None and vertices.ndim == 3:
        vertices, times, added = in_time_order(vertices, times)
    sequence = mesh_sequence(
        checks.given_up(vertices),
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
        ignored=tuple(name.encode(errors="replace").decode() for name in ignored),
        **more,
    )


@shown()
@dataclass(frozen=True)
class ReadOptions:
    """How to read a file, and statements that override its own.

    Parameters
    ----------
    format : Format, optional
        Recognised by content by default; raw numbers need it, or `n_vertices`.
    limits : ReadLimits
    unit : str, optional
        Length unit: m, cm, mm, um or nm; over the file's own.
    times : tuple of float, s, optional
        One for each frame.
    frame_interval : float, s, optional
        In place of `times`: from each frame to the next, the first at zero.
    topology : str, optional
    grid : tuple of int, optional
        Nodes along each axis of a lattice.
    n_vertices : int, optional
        Of raw numbers: vertices per frame; the product of `grid` by default.
    dtype : str
        Of raw numbers: "float32" or "float64", little-endian.
    animation : str, optional
        Of GLB: name of the animation; the first by default.
    facts : Facts
        Further statements, which override the file's: landmarks and covariates by name.
    """

    format: Format | None = None
    limits: ReadLimits = DEFAULT_LIMITS
    unit: str | None = None
    times: tuple[float, ...] | None = None
    frame_interval: float | None = None
    topology: str | None = None
    grid: tuple[int, ...] | None = None
    n_vertices: int | None = None
    dtype: str = "float32"
    animation: str | None = None
    facts: mesh.Facts = mesh.NO_FACTS

    def __post_init__(self) -> None:
        if self.times is not None and self.frame_interval is not None:
            raise errors.ParameterError(
                "Both times and an interval between frames are stated.", remedy="Keep one."
            )
        interval = self.frame_interval
        if interval is not None and not (np.isfinite(interval) and interval > 0):
            raise errors.ParameterError(
                f"The interval between frames is {interval} s.",
                remedy="Use a finite time above zero.",
            )

    def apply(self, result: Reading) -> Reading:
        """Return the reading with everything stated here applied to it.

        Raises
        ------
        InputError
            If a statement does not fit the sequence.
        """
        sequence = result.sequence.with_topology(
            None if self.topology is None else Topology.parse(self.topology), self.grid
        )
        notes, unit_from, times_from = list(result.notes), result.unit_from, result.times_from
        if self.unit is not None:
            if sequence.unit not in (None, self.unit):
                notes.append(Note.of("unit_replaced", unit=sequence.unit, stated=self.unit))
            sequence, unit_from = sequence.with_unit(self.unit), "caller"
        if self.times is not None or self.frame_interval is not None:
            interval = self.frame_interval or 0.0
            stated = self.times or tuple(k * interval for k in range(sequence.n_frames))
            vertices, times, added = in_time_order(sequence.vertices, list(stated))
            notes += added
            if vertices is not sequence.vertices:
                # What is known of the frames' errors is in their old order.
                sequence = replace(sequence, vertices=vertices, times=None, uncertainty=None)
            sequence = replace(sequence, times=checks.require_times(times, len(vertices)))
            times_from = "caller"
        said, known = self.facts.stated, sequence.facts.stated
        if said or known:
            facts = self.facts.over(sequence.facts)
            changed = facts.changed(sequence.facts)
            notes += [
                Note.of("fact_replaced", fact=name)
                for name in said
                if name in known and name in changed
            ]
            sequence = sequence.with_facts(facts)
        return replace(
            result,
            sequence=sequence,
            notes=tuple(notes),
            unit_from=unit_from,
            times_from=times_from,
        )


Parsed = tuple[dict[str, Any], dict[str, Array]]
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
    arrays: dict[str, Array]


class Parser(Protocol):
    """Runs parsers on files: `ParserProcess`, or `ParserHere`."""

    @property
    def limits(self) -> ReadLimits:
        """Limits on a file."""

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file by the parser of that name."""
