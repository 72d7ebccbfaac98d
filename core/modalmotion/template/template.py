"""Templates: what is known of a surface before it moves."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, TopologyError
from modalmotion.lattice import Lattice
from modalmotion.mesh import lattice_faces, vertex_areas
from modalmotion.sequence import MeshSequence
from modalmotion.template.lengths import axis_lengths
from modalmotion.template.surface import Landmarks, natural_coordinates
from modalmotion.topology import OPEN, Topology


class Weights(StrEnum):
    """How much each vertex counts in rotation, fit and error."""

    AREA = "area"
    UNIFORM = "uniform"


@dataclass(frozen=True, eq=False)
class Template:
    """Natural coordinates, weights and lengths of one surface.

    Parameters
    ----------
    id : str
        sha256 of what it was made from, in hex: never of what else was seen before.
    topology : Topology
    coordinates : (vertices, axes) float64
        s in [0, 1] on open and pole axes, theta in turns on closed ones.
    weights : (vertices,) float64
        Share of each vertex in the surface; they add up to 1.
    lengths : tuple of float, length unit
        Length along each axis, circumference on closed ones.
    landmarks : Landmarks or None
        Axis and zero of theta found on a mesh; None on a lattice, whose columns say it.
    notes : tuple of str
        What was met on the way that a user should know.
    """

    id: str
    topology: Topology
    coordinates: NDArray[np.float64]
    weights: NDArray[np.float64]
    lengths: tuple[float, ...]
    landmarks: Landmarks | None
    notes: tuple[str, ...]


def make_template(
    sequence: MeshSequence, *, reference: int = 0, weights: Weights = Weights.AREA
) -> Template:
    """Make the template of a sequence from one of its own frames.

    Parameters
    ----------
    sequence : MeshSequence
    reference : int
        Frame whose shape the coordinates and areas are taken from.
    weights : Weights

    Raises
    ------
    ParameterError
        If there is no such frame.
    TopologyError
        If the surface is none that has natural coordinates, or the stated topology does not
        fit its connectivity.
    """
    if not 0 <= reference < sequence.n_frames:
        raise ParameterError(
            f"The reference is frame {reference}, but there are {sequence.n_frames} frames "
            f"(0 to {sequence.n_frames - 1}).",
            remedy="Name a frame of the sequence, counted from 0.",
        )
    vertices = sequence.vertices[reference].astype(np.float64)
    scale = _power_of_two(vertices - vertices[0])
    corner = vertices[0]
    vertices = (vertices - corner) / scale
    landmarks: Landmarks | None = None
    notes: list[str] = []
    topology, grid = sequence.topology, _grid_of(sequence)
    if grid is not None:
        if topology is None:
            raise TopologyError(
                f"The lattice of {grid} nodes comes without a topology.",
                remedy="Say which ends are joined: topology = cup, cylinder, plane, torus, "
                "sphere, open curve or closed curve.",
            )
        coordinates = Lattice(topology, grid).natural_coordinates
        faces = sequence.faces
        if not len(faces) and topology.n_axes == 2 and min(grid) > 1:
            faces = lattice_faces(topology, grid)
    else:
        faces = sequence.faces
        topology, coordinates, landmarks, found = natural_coordinates(vertices, faces, topology)
        landmarks = replace(landmarks, origin=landmarks.origin * scale + corner)
        notes += found
    if weights == Weights.UNIFORM or not (len(faces) or topology.n_axes == 1):
        shares = np.full(len(vertices), 1.0 / len(vertices))
        if weights == Weights.AREA:
            notes.append("There are no areas to weigh by; all vertices count alike.")
    else:
        shares = _shares(vertices, faces, topology, notes)
    lengths = axis_lengths(vertices, faces, topology, grid, coordinates)
    return Template(
        id=_template_id(sequence, vertices * scale, weights),
        topology=topology,
        coordinates=coordinates,
        weights=shares,
        lengths=tuple(length * scale for length in lengths),
        landmarks=landmarks,
        notes=tuple(notes),
    )


def _grid_of(sequence: MeshSequence) -> tuple[int, ...] | None:
    if sequence.grid is None and sequence.topology is not None and sequence.topology.n_axes == 1:
        return (sequence.n_vertices,)
    return sequence.grid


def _shares(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    topology: Topology,
    notes: list[str],
) -> NDArray[np.float64]:
    if topology.n_axes == 1:
        steps = np.linalg.norm(np.diff(vertices, axis=0, append=vertices[:1]), axis=1)
        if topology.ends[0] == OPEN:
            steps[-1] = 0.0
        areas = (steps + np.roll(steps, 1)) / 2
    else:
        areas = vertex_areas(vertices, faces)
    total = areas.sum()
    if not total > 0:
        notes.append("The surface has no area; all vertices count alike.")
        return np.full(len(vertices), 1.0 / len(vertices))
    weightless = int((areas == 0).sum())
    if weightless:
        notes.append(f"{weightless} vertices belong to no area and have no weight in the fit.")
    shares: NDArray[np.float64] = areas / total
    return shares


def _power_of_two(offsets: NDArray[np.float64]) -> float:
    """Scale that keeps squares of any finite coordinates in range, without rounding."""
    largest = float(np.abs(offsets).max(initial=0.0))
    return 1.0 if largest == 0.0 else float(2.0 ** np.clip(np.frexp(largest)[1], -1000, 1000))


def _template_id(sequence: MeshSequence, reference: NDArray[np.float64], weights: Weights) -> str:
    header = {
        "schema": 1,
        "topology": None if sequence.topology is None else sequence.topology.name,
        "grid": sequence.grid,
        "weights": weights.value,
        "n_vertices": len(reference),
    }
    digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    digest.update(np.ascontiguousarray(sequence.faces.astype("<i8")).data)
    digest.update(np.ascontiguousarray(reference.astype("<f8")).data)
    return digest.hexdigest()
