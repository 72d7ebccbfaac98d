"""Reading options, stated beside a file."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from modalmotion.errors import ParameterError
from modalmotion.formats.detect import Format
from modalmotion.formats.result import Reading
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh import NO_FACTS, Facts
from modalmotion.mesh.checks import require_times
from modalmotion.mesh.sequence import in_time_order
from modalmotion.modes.topology import Topology
from modalmotion.representation import shown


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
    facts: Facts = NO_FACTS

    def __post_init__(self) -> None:
        if self.times is not None and self.frame_interval is not None:
            raise ParameterError(
                "Both times and an interval between frames are stated.", remedy="Keep one."
            )
        interval = self.frame_interval
        if interval is not None and not (np.isfinite(interval) and interval > 0):
            raise ParameterError(
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
                notes.append(
                    f"The file is in {sequence.unit}; it was taken for {self.unit}, as stated."
                )
            sequence, unit_from = sequence.with_unit(self.unit), "caller"
        if self.times is not None or self.frame_interval is not None:
            interval = self.frame_interval or 0.0
            stated = self.times or tuple(k * interval for k in range(sequence.n_frames))
            vertices, times, added = in_time_order(sequence.vertices, list(stated))
            notes += added
            if vertices is not sequence.vertices:
                # What is known of the frames' errors is in their old order.
                sequence = replace(sequence, vertices=vertices, times=None, uncertainty=None)
            sequence = replace(sequence, times=require_times(times, len(vertices)))
            times_from = "caller"
        said, known = self.facts.stated, sequence.facts.stated
        if said or known:
            facts = self.facts.over(sequence.facts)
            changed = facts.changed(sequence.facts)
            notes += [
                f"The file states another {name} than its sender, whose statement counts."
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
