"""Templates: surfaces before they move, and what their coordinates rest on."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, TopologyError
from modalmotion.mesh import face_areas, face_gradients
from modalmotion.mesh.reference import middle_positions, reference_positions
from modalmotion.mesh.sequence import MeshSequence, Reference
from modalmotion.mesh.triangles import mean_slopes, step_lengths
from modalmotion.modes.topology import CLOSED, CUP, CYLINDER, End, Topology
from modalmotion.representation import FrozenArrays, shown
from modalmotion.template.axis import Axes, azimuth, corner_steps, origin_on
from modalmotion.template.landmarks import Coordinates, GivenLandmarks, Landmarks, landmarks_in
from modalmotion.template.surface import Opening, Surface

Places = dict[str, NDArray[np.float64]]

# Step of a difference, on a surface of about size 1.
_STEP: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Placement:
    """Axes of a template, and what they and its coordinates come from.

    Parameters
    ----------
    topology : Topology
    surface, mean : Surface
        The reference, and the mean of all frames in the same place.
    places, mean_places : mapping of str to (3,) float64, scaled
        Stated landmarks on each.
    vertices : mapping of str to int
        Those of them that name a vertex, which is the one on the surface.
    scale : float, length unit
        Of the surfaces.
    axes_of, make : callable
        Find axes on a surface with its places; make coordinates about axes.
    """

    topology: Topology
    surface: Surface
    mean: Surface
    places: Places
    mean_places: Places
    vertices: Mapping[str, int]
    scale: float
    axes_of: Callable[[Surface, Places], Axes]
    make: Callable[..., Coordinates | None]

    @cached_property
    def axes(self) -> Axes:
        """Those of the mean of all frames."""
        return self.axes_of(self.mean, self.mean_places)

    def coordinates(self, axes: Axes, before: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coordinates about other axes, (vertices, axes) float64, like those about its own."""
        surface = self.surface
        if self.topology in (CUP, CYLINDER):
            # Their s is of the openings.
            origin = origin_on(surface, axes.axis, self.places)
            theta = azimuth(surface.vertices - origin, axes.axis, axes.zero)
            return np.stack([before[:, 0], theta], axis=1)
        found = self.make(surface, self.places, axes)
        return before if found is None else found.values

    def slopes(self) -> NDArray[np.float64]:
        """Turn of the axes by errors of the mean's positions.

        The axes follow from area integrals up to the second moment, from the centres of the
        openings and from stated vertices: differences by these, times the slopes of these.

        Returns
        -------
        (3, vertices, 3) float64, rad per length unit
            Of the rotation vector by each position, in the order of the mesh.
        """
        mean, C, o = self.mean, self.mean.covariance, self.mean.offsets
        k = self._turns(lambda step: {"centroid": mean.centroid + step})
        K = np.stack(
            [
                self._turns(lambda step, e=e: {"covariance": C + _symmetric(e, step)})  # type: ignore[misc]
                for e in np.eye(3)
            ],
            axis=1,
        )
        # The area mean of f = k . o + o'K o has these slopes.
        f = k @ o.T + np.einsum("vi,wij,vj->wv", o, K, o)
        slopes = mean_slopes(mean.vertices, mean.faces, f, k[:, None] + 2.0 * o @ K)
        for number, opening in enumerate(mean.openings):

            def changed(
                step: NDArray[np.float64], n: int = number, one: Opening = opening
            ) -> dict[str, tuple[Opening, ...]]:
                other = replace(one, centre=one.centre + step[:3], length=one.length + step[3])
                return {"openings": (*mean.openings[:n], other, *mean.openings[n + 1 :])}

            turns = self._turns(changed, n=4)
            slopes += opening.slopes(mean.vertices, turns[:, :3], turns[:, 3])
        for name, vertex in self.vertices.items():
            slopes[:, vertex] += self._turns(lambda _: {}, name)
        return slopes / self.scale

    def _turns(
        self,
        changed: Callable[[NDArray[np.float64]], Mapping[str, object]],
        place: str = "",
        n: int = 3,
    ) -> NDArray[np.float64]:
        """Rotation vector by each direction of a step in parts of the mean, or in a place."""
        before, columns = self.axes.matrix, []
        for step in _STEP * np.eye(n):
            other, places = copy.copy(self.mean), dict(self.mean_places)
            # Instead of what the surface would work out.
            vars(other).update(changed(step))
            if place:
                places[place] = places[place] + step
            W = self.axes_of(other, places).matrix @ before.T
            columns.append([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]])
        return np.array(columns).T / (2.0 * _STEP)


def _symmetric(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return 0.5 * (np.outer(a, b) + np.outer(b, a))


# Changes with everything that changes coordinates, so that no old template answers for a new one.
_SCHEMA = 3


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
    notes : tuple of str
        Caveats for the user.
    """

    id: str
    surface: Topology | None
    coordinates: NDArray[np.float64]
    weights: NDArray[np.float64]
    lengths: tuple[float, ...]
    landmarks: Landmarks | None
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    representatives: NDArray[np.int64]
    isolated: NDArray[np.int64]
    reason: str
    notes: tuple[str, ...]
    placement: Placement | None = None

    def __post_init__(self) -> None:
        for name in (
            *("coordinates", "weights", "vertices", "faces", "representatives", "isolated"),
        ):
            getattr(self, name).setflags(write=False)

    @property
    def topology(self) -> Topology:
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

    def turned(self, w: NDArray[np.float64]) -> Template:
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
    return has_cells and sequence.topology in (CUP, CYLINDER)


def is_merged(representatives: NDArray[np.int64]) -> bool:
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
            "then gets its own.",
            details={"template": template.n_vertices, "sequence": sequence.n_vertices},
        )
    faces = template.representatives[sequence.faces]
    if len(faces) and not np.array_equal(faces, template.faces):
        raise ParameterError(
            "The template joins its vertices by other triangles than the sequence.",
            remedy="Use a template of the same connectivity, or none: each sequence then gets "
            "its own.",
        )


def axis_lengths(
    surface: Surface,
    topology: Topology,
    grid: tuple[int, ...] | None,
    coordinates: NDArray[np.float64],
) -> tuple[float, ...]:
    """Length along each axis: the reciprocal of the mean gradient of its coordinate.

    An integral over the surface, so it does not hang on single vertices. Around a pole, where
    that gradient has no bound, it is the area over the meridian, which is the same on a surface
    of revolution.

    Returns
    -------
    tuple of float, length unit
        0 along an axis without extent.
    """
    if topology.n_axes == 1 and grid is None:
        return (float(step_lengths(surface.vertices, topology).sum()),)
    if topology.n_axes == 2 and surface.area > 0:
        first = _from_gradients(surface, coordinates[:, 0], topology.ends[0] == CLOSED)
        if End.POLE in topology.ends[0]:
            return first, surface.area / first if first > 0 else 0.0
        return first, _from_gradients(surface, coordinates[:, 1], topology.ends[1] == CLOSED)
    if grid is None:
        return (0.0,) * topology.n_axes
    return tuple(
        _from_steps(surface.vertices.reshape(*grid, 3), axis, ends == CLOSED)
        for axis, ends in enumerate(topology.ends)
    )


def _from_gradients(surface: Surface, coordinate: NDArray[np.float64], closed: bool) -> float:
    areas = face_areas(surface.vertices, surface.faces)
    values = corner_steps(coordinate, surface.faces) if closed else coordinate
    gradients = face_gradients(surface.vertices, surface.faces, values)
    mean = float((areas * np.linalg.norm(gradients, axis=1)).sum() / areas.sum())
    return 1.0 / mean if mean > 0 else 0.0


def _from_steps(nodes: NDArray[np.float64], axis: int, closed: bool) -> float:
    n = nodes.shape[axis]
    ahead = np.roll(nodes, -1, axis=axis) if closed else np.take(nodes, range(1, n), axis=axis)
    here = nodes if closed else np.take(nodes, range(n - 1), axis=axis)
    steps = np.linalg.norm(ahead - here, axis=-1)
    return float(steps.mean() * n) if steps.size else 0.0
