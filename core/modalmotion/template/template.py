"""Templates: surfaces before they move, the modes on them, and their HDF5 files."""

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from modalmotion.arguments.checking import FrozenArrays
from modalmotion.errors import ParameterError, TopologyError
from modalmotion.hdf5 import image
from modalmotion.mesh.alignment import middle_positions, reference_positions
from modalmotion.mesh.sequence import MeshSequence, Reference
from modalmotion.mesh.spring_modes import Modes, spring_modes
from modalmotion.modes import mode_set, topologies
from modalmotion.notes import Note, notes_from_json
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import Floats, Ints, shown
from modalmotion.template.axis import Placement
from modalmotion.template.landmarks import GivenLandmarks, Landmarks, landmarks_in

# Changes with everything that changes coordinates, so that no old template answers for a new one.
_SCHEMA = 4


@shown("topology", "n_vertices", "lengths", "reason", "id")
@dataclass(frozen=True, eq=False)
class Template(FrozenArrays):
    """Natural coordinates, weights and lengths of one surface.

    Parameters
    ----------
    id : str
        sha256 of the content it was made from, in hex, independent of earlier templates.
    surface : Topology or None
        None where no natural coordinates are known: the surface then has the spring modes of
        its own mesh, comparable within the same connectivity only.
    coordinates : (vertices, axes) float64
        s in [0, 1] on open and pole axes, theta in turns on closed ones; no columns where
        there are no natural coordinates.
    weights : (vertices,) float64
        Share of each vertex in the surface; they add up to 1.
    lengths : tuple of float, length unit
        Length along each axis, circumference on closed ones.
    landmarks : Landmarks or None
        None where there is no axis.
    vertices : (vertices, 3) float64, length unit
        The reference it was made from.
    faces : (faces, 3) int64
        Of the mesh, or between the nodes of a lattice; each vertex by its representative.
    representatives : (vertices,) int64
        The vertex that stands for each: the first of those that coincide in every frame and are
        one vertex of the surface; the others have its coordinates and no weight.
    isolated : (n,) int64
        Vertices in no triangle: they carry no weight, are moved as the nearest vertex of the
        surface, and count in every error but the weighted one.
    placement : Placement or None
        What the axes were found on, for the errors that they have of it; None where they are
        stated by a lattice, there are none, or the template was read from a file.
    reason : str
        Why there are no natural coordinates; empty if there are.
    notes : tuple of Note
        Caveats for the user.
    """

    id: str
    surface: topologies.Topology | None
    coordinates: Floats
    weights: Floats
    lengths: tuple[float, ...]
    landmarks: Landmarks | None
    vertices: Floats
    faces: Ints
    representatives: Ints
    isolated: Ints
    reason: str
    notes: tuple[Note, ...]
    placement: Placement | None = None

    @property
    def topology(self) -> topologies.Topology:
        """Topology whose modes are known in closed form.

        Raises
        ------
        TopologyError
            If there is none: `surface` is None then.
        """
        if self.surface is None:
            raise TopologyError(
                f"No natural coordinates are known for this surface. {self.reason}",
                remedy="Use the spring modes of its own mesh, or send one open or closed "
                "surface, or a lattice with grid and topology.",
            )
        return self.surface

    def turned(self, w: Floats) -> "Template":
        """Return the same about axes that are turned by a rotation vector w, (3,), rad.

        Of a template with a placement.
        """
        placed, landmarks = self.placement, self.landmarks
        if placed is None or landmarks is None:
            return self
        axes = placed.axes.turned(w)
        values = placed.coordinates(axes, self.coordinates)[self.representatives]
        landmarks = replace(landmarks, axis=axes.axis, theta_zero=axes.zero)
        return replace(self, coordinates=values, landmarks=landmarks)

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.weights)


def template_id(
    sequence: MeshSequence,
    *,
    reference: Reference = 0,
    landmarks: GivenLandmarks | None = None,
    closed_form: bool = True,
    by_rows: bool = True,
) -> str:
    """Identity of the template that `make_template` would make of the same arguments.

    Returns
    -------
    str
        sha256 in hex, over faces, reference vertices, those of the mean of all frames, topology,
        grid, weights, landmarks and merged vertices.
    """
    shapes = [reference_positions(sequence, reference), middle_positions(sequence, reference)]
    own_landmarks = landmarks_read(sequence, landmarks, closed_form=closed_form)
    header = {
        "schema": _SCHEMA,
        "topology": None if sequence.topology is None else sequence.topology.name,
        "grid": sequence.grid,
        "landmarks": own_landmarks.as_json(),
        "closed_form": closed_form,
        "n_vertices": sequence.n_vertices,
    }
    if not by_rows and is_placed_by_shape(sequence):
        header["by_rows"] = False
    digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    digest.update(np.ascontiguousarray(sequence.faces.astype("<i8")).data)
    for positions in shapes:
        digest.update(np.ascontiguousarray(positions.astype("<f8")).data)
    first = sequence.representatives
    if is_merged(first):
        digest.update(first.astype("<i8").data)
    return digest.hexdigest()


def is_placed_by_shape(sequence: MeshSequence) -> bool:
    """Whether a lattice has, beside rows and columns, coordinates that its surface gives."""
    has_cells = sequence.grid is not None and len(sequence.grid) == 2 and min(sequence.grid) > 2
    return has_cells and sequence.topology in (topologies.CUP, topologies.CYLINDER)


def is_merged(representatives: Ints) -> bool:
    """Whether a vertex stands for another: see `MeshSequence.representatives`."""
    return bool((representatives != np.arange(len(representatives))).any())


def landmarks_read(
    sequence: MeshSequence, landmarks: GivenLandmarks | None, *, closed_form: bool
) -> GivenLandmarks:
    """Landmarks that the template of a sequence uses; see `landmarks_in`."""
    landmarks = GivenLandmarks() if landmarks is None else landmarks
    if not closed_form:
        return landmarks
    is_lattice = sequence.grid is not None
    return landmarks_in(sequence.facts, landmarks, sequence.topology, is_lattice=is_lattice)


def require_same_mesh(template: Template, sequence: MeshSequence) -> None:
    """Check that a sequence's vertices correspond to a template made of another one.

    Raises
    ------
    ParameterError
        If their numbers of vertices or their triangles differ.
    """
    if sequence.n_vertices != template.n_vertices:
        raise ParameterError(
            f"The template has {template.n_vertices} vertices, the sequence {sequence.n_vertices}.",
            remedy="Use a template whose vertices correspond one to one, or none: each sequence "
            "is then given its own.",
        )
    faces = template.representatives[sequence.faces]
    if len(faces) and not np.array_equal(faces, template.faces):
        raise ParameterError(
            "The triangles of the template differ from those of the sequence.",
            remedy="Use a template with the same connectivity, or none: each sequence is then "
            "given its own.",
        )


FASTEST_WAVE: Final = 1e100
"""Largest wave speed, length unit per s: beyond it the energy, which contains its square, may
overflow."""


def require_wave_speed(wave_speed: float) -> None:
    """Refuse what no waves have.

    Raises
    ------
    ParameterError
    """
    if not 0 < wave_speed <= FASTEST_WAVE:
        raise ParameterError(
            f"The wave speed is {wave_speed}.",
            remedy=f"Use a positive speed of at most {FASTEST_WAVE:g}.",
        )


def frequencies_of(modes: Modes, template: Template, wave_speed: float = 1.0) -> Floats:
    """Angular frequencies w = c k of modes on a template's surface.

    Parameters
    ----------
    modes : Modes
    template : Template
    wave_speed : float, length unit per s
        c.

    Returns
    -------
    (modes,) float64, rad per s

    Raises
    ------
    ParameterError
        If no waves have this speed, or a frequency is beyond the largest number.
    """
    require_wave_speed(wave_speed)
    with np.errstate(over="ignore"):
        frequencies = modes.frequencies_on(template, wave_speed)
    if not np.isfinite(frequencies).all():
        raise ParameterError(
            f"Waves of {wave_speed:g} length units per s on a surface with lengths "
            f"{', '.join(f'{length:.3g}' for length in template.lengths)} have frequencies that "
            "overflow.",
            remedy="Use a smaller unit of length, or a smaller wave speed.",
        )
    return frequencies


# Extents of the surface; farther vertices are looked for from here, where squares are usual.
_FARTHEST: Final = 1e6


def nearest_in_use(vertices: Floats, isolated: Ints) -> Ints:
    """Vertex of the surface nearest to each isolated one.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
        Isolated ones may lie anywhere.
    isolated : (n,) int64

    Returns
    -------
    (n,) int64
        Itself where no vertex is in use.
    """
    used = np.delete(np.arange(len(vertices)), isolated)
    if not len(used):
        return isolated
    corner = vertices[used[0]]
    surface = vertices[used] - corner
    scale = power_of_two(float(np.abs(surface).max(initial=0.0)))
    with np.errstate(over="ignore"):
        apart = np.clip((vertices[isolated] - corner) / scale, -_FARTHEST, _FARTHEST)
    return np.asarray(used[scipy.spatial.cKDTree(surface / scale).query(apart)[1]])


def carried_over(values: Floats, vertices: Floats, isolated: Ints) -> Floats:
    """Values of vertices, (vertices, ...); isolated ones have those of their nearest in use."""
    if not len(isolated):
        return values
    values = values.copy()
    values[isolated] = values[nearest_in_use(vertices, isolated)]
    return values


def shapes_of(modes: Modes, template: Template) -> Floats:
    """Mode shapes at all vertices of a template, isolated ones as their nearest in use.

    Returns
    -------
    (vertices, modes) float64
    """
    return carried_over(modes.shapes_on(template), template.vertices, template.isolated)


def choose_modes(
    template: Template, n_modes: int, grid: tuple[int, ...] | None = None
) -> tuple[Modes, tuple[Note, ...]]:
    """Lowest modes of a template, rounded up so that no cosine-sine pair is split.

    Parameters
    ----------
    template : Template
    n_modes : int
    grid : tuple of int, optional
        Nodes along each axis of a lattice, which has no modes beyond its own number.

    Returns
    -------
    modes : Modes
        In closed form where the surface has natural coordinates.
    notes : tuple of Note
        Why there are more than requested, or that they belong to one mesh only.

    Raises
    ------
    ModeCountError
        If there are not that many.
    """
    if template.surface is None:
        springs = spring_modes(template.faces, template.n_vertices, n_modes)
        note = Note.of("mesh_modes")
        return replace(springs, shapes=springs.shapes[template.representatives]), (note,)
    n_whole = mode_set.whole_count(template.surface, n_modes, grid)
    chosen = mode_set.lowest_modes(template.surface, n_whole, grid)
    if n_whole == n_modes:
        return chosen, ()
    note = Note.of("modes_rounded", asked=n_modes, n_modes=n_whole, n_amplitudes=3 * n_whole)
    return chosen, (note,)


FORM: Final = image.Form("template", 3)

_FACES: Final = {"faces": ("1", "face, corner")}
# Without the faces, which a sequence in the same file has.
_ARRAYS: Final = {
    "vertices": ("{u}", "vertex, direction"),
    "coordinates": ("1", "vertex, axis"),
    "weights": ("1", "vertex"),
    "lengths": ("{u}", "axis of the surface"),
    "representatives": ("1", "vertex"),
    "isolated": ("1", "isolated vertex"),
}


def template_to_hdf5(template: Template) -> bytes:
    """Write a template as a sealed HDF5 file in memory.

    Parameters
    ----------
    template : Template

    Returns
    -------
    bytes
        The same for the same template.
    """
    unit = "length unit of the sequence"
    datasets = [*image.datasets_of(template, _FACES), *template_datasets(template, unit)]
    topology = topologies.MESH if template.surface is None else template.surface.name
    return FORM.image({"template_id": template.id}, datasets, topology=topology)


def template_datasets(
    template: Template, unit: str | None, prefix: str = ""
) -> list[image.Dataset]:
    """Datasets of a template without its faces, with this before their names."""
    texts = {"reason": template.reason, "notes": template.notes}
    datasets = [
        *image.datasets_of(template, _ARRAYS, unit, prefix=prefix),
        image.json_text(f"{prefix}texts", texts),
    ]
    if template.landmarks is not None:
        datasets += landmark_datasets(template.landmarks, unit)
    return datasets


def template_from_hdf5(source: bytes | Path, ids: image.Ids = image.ANY_IDS) -> Template:
    """Read a template, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path
    ids : mapping
        Attributes that it must have.

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    with FORM.read(source, ids) as contents:
        return template_in(contents)


def template_in(contents: image.Contents, prefix: str = "") -> Template:
    """Template that the contents of a file have; see `template_datasets`."""
    name, texts = contents.text("topology"), contents.json(f"{prefix}texts", dict)
    sizes = {"direction": 3, "corner": 3}
    arrays = contents.table(_FACES, sizes) | contents.table(_ARRAYS, sizes, prefix=prefix)
    return Template(
        **{**arrays, "lengths": tuple(arrays["lengths"].tolist())},
        id=contents.text("template_id"),
        surface=None if name == topologies.MESH else topologies.Topology.parse(name),
        landmarks=landmarks_from(contents),
        reason=texts["reason"],
        notes=notes_from_json(texts["notes"]),
    )


_VECTORS: Final = ("origin", "axis", "theta_zero", "apex", "base")


def landmark_datasets(landmarks: Landmarks, unit: str | None) -> list[image.Dataset]:
    """Datasets that contain landmarks."""
    vectors = np.array([getattr(landmarks, name) for name in _VECTORS], dtype=np.float64)
    rest = {
        "strengths": dict(landmarks.strengths),
        "n_loops": landmarks.n_loops,
        "given": landmarks.given,
    }
    axes = "origin axis theta_zero apex base, direction"
    return [
        image.Dataset("landmarks", vectors, unit or image.UNKNOWN, axes),
        image.json_text("landmark_strengths", rest),
    ]


def landmarks_from(contents: image.Contents) -> Landmarks | None:
    """Landmarks that a file holds, None if there are none."""
    if "landmarks" not in contents.arrays:
        return None
    vectors = contents.array("landmarks", (len(_VECTORS), 3))
    rest = contents.json("landmark_strengths", dict)
    return Landmarks(
        **dict(zip(_VECTORS, vectors, strict=True)),
        strengths=rest["strengths"],
        n_loops=rest["n_loops"],
        given=tuple(rest["given"]),
    )
