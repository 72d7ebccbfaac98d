"""Mesh sequences: one connectivity, positions over time."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.tasks import Recorded
from modalmotion.errors import ParameterError, ShapeError
from modalmotion.facts import NO_FACTS, Facts
from modalmotion.mesh.checks import FloatArray, require_faces, require_times, require_vertices
from modalmotion.mesh.coincidence import representatives_of
from modalmotion.mesh.uncertainty import Uncertainty
from modalmotion.modes.order import require_shape
from modalmotion.modes.topology import Topology
from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown

MM_PER_UNIT: Final[dict[str, float]] = {
    "m": 1e3,
    "cm": 10.0,
    "mm": 1.0,
    "um": 1e-3,
    "nm": 1e-6,
}
"""Known length units, in millimetres."""


MEAN: Final = "mean"

Reference: TypeAlias = int | Literal["mean"]
"""Origin of displacements: a frame, or `MEAN`, the mean shape."""


@shown("n_frames", "n_vertices", "faces", "topology", "unit")
@dataclass(frozen=True, eq=False)
class MeshSequence(FrozenArrays, Recorded):
    """A surface that moves: the same vertices and faces in every frame.

    Make one with `mesh_sequence`, which checks everything.

    Parameters
    ----------
    vertices : (frames, vertices, 3) float32 or float64, in `unit`
    faces : (faces, 3) int64
        Triangles; none for contours and bare lattices.
    grid : tuple of int, optional
        Nodes along each axis if the vertices are those of a lattice, vertex = row * N' +
        column.
    topology : Topology, optional
        As the sender states it; otherwise the connectivity decides.
    times : (frames,) float64, s, optional
    unit : str, optional
        Length unit: m, cm, mm, um or nm; None where it is unknown.
    facts : Facts
        Further statements of the sender; not part of the id.
    uncertainty : Uncertainty, optional
        How far its positions may be off, where that is known; not part of the id.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    grid: tuple[int, ...] | None = None
    topology: Topology | None = None
    times: NDArray[np.float64] | None = None
    unit: str | None = None
    facts: Facts = NO_FACTS
    uncertainty: Uncertainty | None = None

    def __post_init__(self) -> None:
        for array in (self.vertices, self.faces, self.times):
            if array is not None:
                array.setflags(write=False)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.vertices)

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return int(self.vertices.shape[1])

    @property
    def span(self) -> float | None:
        """From the first time to the last, in s; None where times are unknown."""
        return None if self.times is None else float(self.times[-1] - self.times[0])

    @cached_property
    def id(self) -> str:
        """Identity of the content: sha256 in hex.

        Over the canonical arrays, unit, times and topology, and not over facts. Positions that
        float32 holds exactly count as float32, so the same numbers have the same id in either
        type.
        """
        vertices = self.vertices
        if vertices.dtype != np.float32:
            with np.errstate(over="ignore"):
                narrow = vertices.astype(np.float32)
            if np.array_equal(narrow, vertices):
                vertices = narrow
        header = {
            "schema": 1,
            "shape": list(vertices.shape),
            "dtype": vertices.dtype.name,
            "faces": len(self.faces),
            "grid": self.grid,
            "topology": None if self.topology is None else self.topology.name,
            "times": self.times is not None,
            "unit": self.unit,
        }
        digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
        little = vertices.dtype.newbyteorder("<")
        digest.update(np.ascontiguousarray(vertices).astype(little, copy=False).data)
        digest.update(np.ascontiguousarray(self.faces.astype("<i8")).data)
        if self.times is not None:
            digest.update(np.ascontiguousarray(self.times.astype("<f8")).data)
        return digest.hexdigest()

    @cached_property
    def representatives(self) -> NDArray[np.int64]:
        """Vertex that stands for each, (vertices,) int64: see `representatives_of`.

        The vertex itself where it is alone, and on curves and lattices, whose order says which
        are neighbours.
        """
        is_curve = self.topology is not None and self.topology.n_axes == 1
        if self.grid is not None or is_curve or not len(self.faces):
            return np.arange(self.n_vertices)
        return representatives_of(self.vertices, self.faces)

    def require_reference(self, reference: Reference) -> None:
        """Check that a reference exists.

        Raises
        ------
        ParameterError
            If it is neither a frame of the sequence nor `MEAN`.
        """
        if isinstance(reference, str):
            is_there = reference == MEAN
        else:
            # True is 1, and 1.5 lies between two frames.
            is_whole = type(reference) is int or isinstance(reference, np.integer)
            is_there = is_whole and 0 <= reference < self.n_frames
        if not is_there:
            raise ParameterError(
                f"The reference is frame {reference!r}, but there are {self.n_frames} frames "
                f"(0 to {self.n_frames - 1}).",
                remedy=f"Name a frame of the sequence, counted from 0, or {MEAN!r}.",
            )

    def with_unit(self, unit: str) -> MeshSequence:
        """Return the same numbers in another length unit.

        Raises
        ------
        ParameterError
            If the unit is not in `MM_PER_UNIT`.
        """
        _require_unit(unit)
        return replace(self, unit=unit)

    def with_times(self, times: Any) -> MeshSequence:
        """Return the same frames at other times, in s, or at unknown ones (None).

        Raises
        ------
        InputError
            If there is not one for each frame, or they do not rise.
        """
        times = None if times is None else require_times(times, self.n_frames)
        return replace(self, times=times)

    def with_facts(self, facts: Facts) -> MeshSequence:
        """Return the same sequence, and the same id, with these facts.

        Raises
        ------
        ParameterError
            If they contradict its vertices or times.
        """
        facts.require_fit(self.n_vertices, self.span)
        return replace(self, facts=facts)

    def with_topology(
        self, topology: Topology | None, grid: tuple[int, ...] | None
    ) -> MeshSequence:
        """Return the same sequence with another topology or lattice shape; None keeps its own."""
        if topology is None and grid is None:
            return self
        grid = self.grid if grid is None else grid
        topology = self.topology if topology is None else topology
        _require_grid(grid, topology, self.n_vertices)
        return replace(self, topology=topology, grid=grid)


def mesh_sequence(
    vertices: Any,
    faces: Any = None,
    *,
    grid: Any = None,
    topology: Topology | str | None = None,
    times: Any = None,
    unit: str | None = None,
    facts: Facts | None = None,
) -> MeshSequence:
    """Make a mesh sequence from arrays, checking all of them.

    Parameters
    ----------
    vertices : (frames, vertices, 3) array_like, in `unit`
        Copied, unless it is read-only and owns its numbers.
    faces : (faces, 3) array_like of int, optional
    grid : sequence of int, optional
        Nodes along each axis of a lattice.
    topology : Topology or str, optional
    times : (frames,) array_like, s, optional
    unit : str, optional
        m, cm, mm, um or nm.
    facts : Facts, optional
        Further statements; all unknown by default.

    Raises
    ------
    InputError
        The subclass names the error; frame and vertex are named where one is at fault.
    """
    positions = require_vertices(vertices)
    n_frames, n_vertices, _ = positions.shape
    if isinstance(topology, str):
        topology = Topology.parse(topology)
    if grid is not None:
        shape = np.asarray(grid)
        if shape.dtype.kind not in "iu" or shape.ndim != 1 or not 1 <= shape.size <= 3:
            raise ShapeError(
                f"'grid' is {grid!r}, not one to three whole numbers.",
                remedy="Give the number of nodes along each axis.",
            )
        grid = tuple(int(n) for n in shape)
    _require_grid(grid, topology, n_vertices)
    if unit is not None:
        _require_unit(unit)
    sequence = MeshSequence(
        vertices=positions,
        faces=require_faces([] if faces is None else faces, n_vertices, n_frames),
        grid=grid,
        topology=topology,
        times=None if times is None else require_times(times, n_frames),
        unit=unit,
    )
    return sequence if facts is None else sequence.with_facts(facts)


def _require_unit(unit: str) -> None:
    if unit not in MM_PER_UNIT:
        raise ParameterError(
            f"The unit {unit[:20]!r} is not understood.",
            remedy=f"Use one of {', '.join(MM_PER_UNIT)}, or leave it out if it is unknown.",
        )


def _require_grid(grid: tuple[int, ...] | None, topology: Topology | None, n_vertices: int) -> None:
    if grid is None:
        return
    n_nodes = 1
    for n in grid:
        n_nodes *= n
    if n_nodes != n_vertices or min(grid) < 1:
        raise ShapeError(
            f"A grid of {' x '.join(map(str, grid))} nodes does not fit {n_vertices} vertices.",
            remedy="The product of the grid must be the number of vertices.",
            details={"grid": list(grid), "n_vertices": n_vertices},
        )
    if topology is not None:
        require_shape(topology, grid)
