"""Mesh sequences: one connectivity, positions over time; HDF5 files, and standard surfaces."""

import hashlib
import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

import numpy as np

from modalmotion.arguments.checking import FrozenArrays, Recorded
from modalmotion.errors import ParameterError, ShapeError, TopologyError
from modalmotion.hdf5 import image
from modalmotion.mesh import checks, fact_forms, triangles
from modalmotion.mesh.facts import NO_FACTS, Facts
from modalmotion.modes import topologies
from modalmotion.modes.lattice import Lattice
from modalmotion.notes import Note
from modalmotion.representation import Array, FloatArray, Floats, Ints, counted, shown

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
        Length unit: m, cm, mm, um or nm; None if it is unknown.
    facts : Facts
        Further statements of the sender; not part of the id.
    uncertainty : Uncertainty, optional
        How far its positions may be off, where that is known; not part of the id.
    """

    vertices: FloatArray
    faces: Ints
    grid: tuple[int, ...] | None = None
    topology: topologies.Topology | None = None
    times: Floats | None = None
    unit: str | None = None
    facts: Facts = NO_FACTS
    uncertainty: checks.Uncertainty | None = None

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
        """From the first time to the last, in s; None if times are unknown."""
        return None if self.times is None else float(self.times[-1] - self.times[0])

    @property
    def volumes(self) -> Floats:
        """Volume enclosed in each frame, openings capped: (frames,) float64, length unit cubed."""
        return self.readouts().mesh_curve.volumes

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
    def representatives(self) -> Ints:
        """Vertex that represents each, (vertices,) int64: see `representatives_of`.

        The vertex itself where it is alone, and on curves and lattices, whose order says which
        are neighbours.
        """
        is_curve = self.topology is not None and self.topology.n_axes == 1
        if self.grid is not None or is_curve or not len(self.faces):
            return np.arange(self.n_vertices)
        return triangles.representatives_of(self.vertices, self.faces)

    @property
    def joined(self) -> Ints:
        """Its triangles, or those between the nodes of a lattice that has none of its own."""
        is_bare = self.grid is not None and not len(self.faces) and min(self.grid) > 1
        if is_bare and self.grid and self.topology is not None and self.topology.n_axes == 2:
            return lattice_faces(self.topology, self.grid)
        return self.faces

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
            # True is 1, and 1.5 is between two frames.
            is_whole = type(reference) is int or isinstance(reference, np.integer)
            is_there = is_whole and 0 <= reference < self.n_frames
        if not is_there:
            raise ParameterError(
                f"The reference is frame {reference!r}, but there are {self.n_frames} frames "
                f"(0 to {self.n_frames - 1}).",
                remedy=f"Name a frame of the sequence, counted from 0, or {MEAN!r}.",
            )

    def with_unit(self, unit: str) -> "MeshSequence":
        """Return the same numbers in another length unit.

        Raises
        ------
        ParameterError
            If the unit is not in `MM_PER_UNIT`.
        """
        _require_unit(unit)
        return replace(self, unit=unit)

    def with_times(self, times: Any) -> "MeshSequence":
        """Return the same frames at other times, in s, or at unknown ones (None).

        Raises
        ------
        InputError
            If there is not one for each frame, or they do not rise.
        """
        times = None if times is None else checks.require_times(times, self.n_frames)
        return replace(self, times=times)

    def with_facts(self, facts: Facts) -> "MeshSequence":
        """Return the same sequence, and the same id, with these facts.

        Raises
        ------
        ParameterError
            If they contradict its vertices or times.
        """
        facts.require_fit(self.n_vertices, self.span)
        return replace(self, facts=facts)

    def with_topology(
        self, topology: topologies.Topology | None, grid: tuple[int, ...] | None
    ) -> "MeshSequence":
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
    topology: topologies.Topology | str | None = None,
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
    positions = checks.require_vertices(vertices)
    n_frames, n_vertices, _ = positions.shape
    if isinstance(topology, str):
        topology = topologies.Topology.parse(topology)
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
        faces=checks.require_faces([] if faces is None else faces, n_vertices, n_frames),
        grid=grid,
        topology=topology,
        times=None if times is None else checks.require_times(times, n_frames),
        unit=unit,
    )
    return sequence if facts is None else sequence.with_facts(facts)


def _require_unit(unit: str) -> None:
    if unit not in MM_PER_UNIT:
        raise ParameterError(
            f"The unit {unit[:20]!r} is not understood.",
            remedy=f"Use one of {', '.join(MM_PER_UNIT)}, or leave it out if it is unknown.",
        )


def _require_grid(
    grid: tuple[int, ...] | None, topology: topologies.Topology | None, n_vertices: int
) -> None:
    if grid is None:
        return
    n_nodes = 1
    for n in grid:
        n_nodes *= n
    if n_nodes != n_vertices or min(grid) < 1:
        raise ShapeError(
            f"A grid of {' x '.join(map(str, grid))} nodes does not fit {n_vertices} vertices.",
            remedy="The product of the grid must be the number of vertices.",
        )
    if topology is not None:
        topologies.require_shape(topology, grid)


def in_time_order(vertices: FloatArray, times: Any) -> tuple[FloatArray, Any, tuple[Note, ...]]:
    """Sort frames by their time stamps, and drop repetitions.

    Parameters
    ----------
    vertices : (frames, vertices, 3) float
    times : (frames,) array_like, s
        Returned unchanged unless it is a list of finite numbers, one for each frame: the check of
        sequences reports the error.

    Returns
    -------
    vertices : (n, vertices, 3) float
        The same array where nothing changed.
    times : (n,) float64, s
    notes : tuple of str
        Changes to the frames.

    Raises
    ------
    ShapeError
        If two frames of the same time differ.
    """
    stamps: Array = np.asarray(times)
    is_list = stamps.dtype.kind in "fiu" and stamps.shape == np.shape(vertices)[:1]
    if not is_list or not np.isfinite(stamps).all() or (np.diff(stamps) > 0).all():
        return vertices, times, ()
    order = np.argsort(stamps, kind="stable")
    notes = []
    if (np.diff(stamps) < 0).any():
        first = int(np.flatnonzero(np.diff(stamps) < 0)[0]) + 1
        notes.append(Note.of("frames_reordered", first=first))
    sorted_times = stamps[order]
    repeats = np.flatnonzero(np.diff(sorted_times) == 0) + 1
    for at in repeats.tolist():
        one, other = int(order[at - 1]), int(order[at])
        if not np.array_equal(vertices[one], vertices[other]):
            raise ShapeError(
                f"Frames {one} and {other} both have the time {sorted_times[at]} s, but differ.",
                remedy="Say which is right: send one of them, or give them different times.",
                frame=other,
            )
    if len(repeats):
        notes.append(
            Note.of(
                "frames_repeated",
                frames=counted(len(repeats), "frame"),
                first=int(order[repeats[0]]),
            )
        )
    distinct = np.delete(order, repeats)
    return vertices[distinct], stamps[distinct].astype(np.float64), tuple(notes)


FORM: Final = image.Form("sequence", 2)

TRACK: Final = image.Form("track", 6)
"""Of a track, which contains its sequence in the same way."""

_ARRAYS: Final = {
    "vertices": ("{u}", "frame, vertex, direction"),
    "faces": ("1", "face, corner"),
    "times": ("s", "frame"),
}


def sequence_to_hdf5(sequence: MeshSequence) -> bytes:
    """Write a mesh sequence as a sealed HDF5 file in memory.

    Parameters
    ----------
    sequence : MeshSequence

    Returns
    -------
    bytes
        The same for the same sequence.
    """
    return FORM.image(
        {"sequence_id": sequence.id},
        sequence_datasets(sequence),
        unit=sequence.unit or image.UNKNOWN,
        topology=None if sequence.topology is None else sequence.topology.name,
        grid=sequence.grid,
    )


def sequence_datasets(sequence: MeshSequence) -> list[image.Dataset]:
    """Datasets of a sequence, in its own file or in that of a track."""
    facts = image.json_text("facts", fact_forms.facts_as_json(sequence.facts))
    return [*image.datasets_of(sequence, _ARRAYS, sequence.unit), facts]


def sequence_from_hdf5(
    source: bytes | Path, form: image.Form = FORM, ids: image.Ids = image.ANY_IDS
) -> MeshSequence:
    """Read a mesh sequence, bit for bit as written.

    Parameters
    ----------
    source : bytes or Path
    form : Form
        `TRACK` reads the sequence of a track, without its errors.
    ids : mapping
        Attributes that it must have.

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    with form.read(source, ids) as contents:
        return sequence_in(contents)


def sequence_in(contents: image.Contents) -> MeshSequence:
    """Sequence that the contents of a file have."""
    arrays = contents.table(_ARRAYS, {"direction": 3, "corner": 3}, optional=("times",))
    return mesh_sequence(
        checks.given_up(arrays.pop("vertices")),
        **arrays,
        grid=contents.attributes.get("grid"),
        topology=contents.optional_text("topology"),
        unit=contents.unit,
        facts=fact_forms.facts_from_json(contents.json("facts", dict)),
    )


def lattice_faces(topology: topologies.Topology, shape: tuple[int, ...]) -> Ints:
    """Triangles that join the nodes of a two-axis lattice: each cell in two.

    Returns
    -------
    (faces, 3) int64
        Poles stay open: the ring of nodes next to a pole bounds a hole half a step wide.
    """
    rows, columns = shape
    index = np.arange(rows * columns).reshape(shape)
    for axis, ends in enumerate(topology.ends):
        if ends == topologies.CLOSED and shape[axis] > 2:
            index = np.concatenate([index, np.take(index, [0], axis=axis)], axis=axis)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])


# Circumference one turn of radius 1; the axis 0.55 of it, as in the order of modes.
_AXIS: Final = 0.55 * 2.0 * np.pi
_TUBE: Final = 0.45


def standard_surface(lattice: Lattice) -> MeshSequence:
    """Place a lattice in space, radius 1.

    Parameters
    ----------
    lattice : Lattice
        A curve or a surface.

    Returns
    -------
    MeshSequence
        One frame, without a unit: a straight line, a circle, a flat plane, a tube, a torus, half
        a spheroid or a sphere.

    Raises
    ------
    TopologyError
        If its topology is another.
    """
    topology = lattice.topology
    coordinates = topologies.lattice_coordinates(topology, lattice.shape)
    s, theta = coordinates[:, 0], 2.0 * np.pi * coordinates[:, -1]
    # Distance from the axis and height along it, of surfaces of revolution.
    profiles = {
        topologies.CLOSED_CURVE: (1.0, 0.0 * s),
        topologies.CYLINDER: (1.0, _AXIS * (s - 0.5)),
        topologies.TORUS: (1.0 + _TUBE * np.cos(2.0 * np.pi * s), _TUBE * np.sin(2.0 * np.pi * s)),
        topologies.CUP: (np.sin(0.5 * np.pi * s), -2.0 * np.cos(0.5 * np.pi * s)),
        topologies.SPHERE: (np.sin(np.pi * s), -np.cos(np.pi * s)),
    }
    if topology in profiles:
        r, z = profiles[topology]
        x = np.stack([r * np.cos(theta), r * np.sin(theta), z], axis=1)
    elif topology in (topologies.OPEN_CURVE, topologies.PLANE):
        across = theta - np.pi if topology == topologies.PLANE else _AXIS * (s - 0.5)
        along = _AXIS * (s - 0.5) if topology == topologies.PLANE else 0.0 * s
        x = np.stack([across, along, 0.0 * s], axis=1)
    else:
        raise TopologyError(
            f"A lattice {topology} is not a surface.",
            remedy="Use an open or closed curve, plane, cylinder, torus, cup or sphere.",
        )
    faces = lattice_faces(topology, lattice.shape) if topology.n_axes == 2 else None
    return mesh_sequence(x[None], faces, grid=lattice.shape, topology=topology)
