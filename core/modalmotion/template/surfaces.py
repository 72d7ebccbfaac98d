"""A prepared reference surface: triangles, areas, moments, openings, and its topology."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from modalmotion import errors, mesh
from modalmotion.mesh import triangles
from modalmotion.modes.topologies import (
    CLOSED,
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    PLANE,
    SPHERE,
    TORUS,
    End,
    Topology,
)
from modalmotion.representation import Floats, Ints, shown


@shown("vertices", "faces")
@dataclass(frozen=True, eq=False)
class Surface:
    """One frame of a mesh, scaled so that squares of its coordinates are harmless.

    Parameters
    ----------
    vertices : (vertices, 3) float64, scaled
    faces : (faces, 3) int64
        Without those that name a vertex twice or repeat another.
    areas : (vertices,) float64, scaled
    connectivity : Connectivity
    """

    vertices: Floats
    faces: Ints
    areas: Floats
    connectivity: mesh.Connectivity

    def moved_to(self, vertices: Floats) -> "Surface":
        """Give the same triangles at other places, (vertices, 3)."""
        return replace(self, vertices=vertices, areas=mesh.vertex_areas(vertices, self.faces))

    @property
    def area(self) -> float:
        """Total area."""
        return float(self.areas.sum())

    @cached_property
    def centroid(self) -> Floats:
        """Area centroid, (3,)."""
        return (self.areas @ self.vertices) / self.area

    @cached_property
    def offsets(self) -> Floats:
        """Positions from the area centroid, (vertices, 3)."""
        return self.vertices - self.centroid

    @cached_property
    def covariance(self) -> Floats:
        """Second moments of its area about the centroid, over the area, (3, 3)."""
        return ((self.offsets * self.areas[:, None]).T @ self.offsets) / self.area

    @cached_property
    def wound_faces(self) -> Ints | None:
        """Triangles wound the same way round: see `oriented_faces`."""
        return mesh.oriented_faces(self.faces, len(self.vertices))

    @property
    def isolated(self) -> Ints:
        """Vertices in no triangle."""
        return self.connectivity.isolated

    @cached_property
    def openings(self) -> "tuple[Opening, ...]":
        """The boundary loops, the longest first."""
        openings = [Opening.of(self.vertices, loop) for loop in self.connectivity.loops]
        return tuple(sorted(openings, key=lambda opening: -opening.length))


@dataclass(frozen=True, eq=False)
class Opening:
    """One boundary loop.

    Parameters
    ----------
    vertices : (n,) int64
    centre : (3,) float64
        Centroid of its edges by length.
    length : float
    edges : (edges, 2) int64
    """

    vertices: Ints
    centre: Floats
    length: float
    edges: Ints

    @staticmethod
    def of(vertices: Floats, loop: Ints) -> "Opening":
        """Measure a loop of edges, (edges, 2)."""
        a, b = vertices[loop[:, 0]], vertices[loop[:, 1]]
        lengths = np.linalg.norm(b - a, axis=1)
        total = float(lengths.sum())
        centre = (lengths @ ((a + b) / 2)) / total if total > 0 else a.mean(axis=0)
        return Opening(np.unique(loop), centre, total, loop)

    def slopes(self, vertices: Floats, weights: Floats, of_length: Floats) -> Floats:
        """Differentiate weights @ centre + of_length * length by the positions.

        Parameters
        ----------
        vertices : (vertices, 3) float64
        weights : (functions, 3) float64
        of_length : (functions,) float64

        Returns
        -------
        (functions, vertices, 3) float64
        """
        a, b = vertices[self.edges[:, 0]], vertices[self.edges[:, 1]]
        sides, total = b - a, self.length or 1.0
        lengths = np.linalg.norm(sides, axis=1)
        sides /= np.where(lengths > 0, lengths, 1.0)[:, None]
        # C = sum L m / sum L: dC = sum ((m - C) dL + L dm) / sum L
        apart = weights @ ((a + b) / 2 - self.centre).T + (of_length * total)[:, None]
        along = apart[:, :, None] * sides
        of_middle = 0.5 * weights[:, None] * lengths[:, None]
        slopes = np.zeros((len(weights), len(vertices), 3))
        for function, length, middle in zip(slopes, along, of_middle, strict=True):
            np.add.at(function, self.edges[:, 0], (middle - length) / total)
            np.add.at(function, self.edges[:, 1], (middle + length) / total)
        return slopes


def mean_of(openings: tuple[Opening, ...]) -> Floats:
    """Centroid of several openings by length, (3,)."""
    lengths = np.array([opening.length for opening in openings])
    centres = np.stack([opening.centre for opening in openings])
    total = float(lengths.sum())
    shares = lengths / total if total > 0 else np.full(len(lengths), 1.0 / len(lengths))
    return shares @ centres


def surface_of(vertices: Floats, faces: Ints) -> Surface:
    """Measure a mesh.

    Parameters
    ----------
    vertices : (vertices, 3) float64, scaled
    faces : (faces, 3) int64
    """
    connectivity = mesh.connectivity_of(faces, len(vertices))
    proper: Ints = np.delete(faces, connectivity.left_out, axis=0)
    return Surface(vertices, proper, mesh.vertex_areas(vertices, proper), connectivity)


# Times that the difference from the mean shape is averaged over neighbours. More leave no less
# error in amplitudes, and flatten what a frame has of its own (docs/decisions/0039).
_ROUNDS: Final = 2


def steady_shape(start: Floats, middle: Floats, faces: Ints, topology: Topology | None) -> Floats:
    """Take out of a reference the roughness that its frame alone has.

    The mean of all frames, and the reference's difference from it as far as it is smooth: over
    what is left of it after averages the same averages are taken once more, so that long waves
    stay as they are (Tukey's twicing).

    Parameters
    ----------
    start, middle : (vertices, 3) float64
        The reference, and the mean of all frames where it is.
    faces : (faces, 3) int64
    topology : Topology or None
        Of curves, whose vertices are neighbours in order.

    Returns
    -------
    (vertices, 3) float64
        The reference to the last bit where the mean is.
    """
    apart = start - middle
    is_curve = topology is not None and topology.n_axes == 1
    if not apart.any() or not (is_curve or len(faces)):
        return start
    n = len(start)
    if is_curve:
        i = np.arange(n)
        i, j = (i, np.roll(i, -1)) if topology == CLOSED_CURVE else (i[:-1], i[1:])
    else:
        i, j = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    own = np.arange(n)
    rows, columns = np.concatenate([i, j, own]), np.concatenate([j, i, own])
    averages = scipy.sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    # Two triangles at an edge join its ends once.
    counts = np.diff(averages.indptr)
    averages.data = np.repeat(1.0 / counts, counts)

    def smooth(field: Floats) -> Floats:
        for _ in range(_ROUNDS):
            field = averages @ field
        return field

    once = smooth(apart)
    return middle + once + smooth(apart - once)


def corner_steps(angle: Floats, faces: Ints) -> Floats:
    """Take an angle in turns to each triangle's corners, unwrapped about the first, (faces, 3)."""
    corners = angle[faces]
    corners = corners - corners[:, :1]
    corners -= np.round(corners)
    return corners


def axis_lengths(
    surface: Surface, topology: Topology, grid: tuple[int, ...] | None, coordinates: Floats
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
        return (float(triangles.step_lengths(surface.vertices, topology).sum()),)
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


def _from_gradients(surface: Surface, coordinate: Floats, closed: bool) -> float:
    areas = triangles.face_areas(surface.vertices, surface.faces)
    values = corner_steps(coordinate, surface.faces) if closed else coordinate
    gradients = triangles.face_gradients(surface.vertices, surface.faces, values)
    mean = float((areas * np.linalg.norm(gradients, axis=1)).sum() / areas.sum())
    return 1.0 / mean if mean > 0 else 0.0


def _from_steps(nodes: Floats, axis: int, closed: bool) -> float:
    n = nodes.shape[axis]
    ahead = np.roll(nodes, -1, axis=axis) if closed else np.take(nodes, range(1, n), axis=axis)
    here = nodes if closed else np.take(nodes, range(n - 1), axis=axis)
    steps = np.linalg.norm(ahead - here, axis=-1)
    return float(steps.mean() * n) if steps.size else 0.0


# A base nearer to the area centroid than this gives no axis.
FAINT_AXIS: Final = 0.02

# A sheet whose thickness is below this share of its length has no side for an apex to be on.
_FLAT: Final = 0.05


def axis_strength(surface: Surface) -> float:
    """How far the base is from the area centroid, 0 for a flat sheet, 1 for a deep cup."""
    # A hemisphere of the same area has its base at half this radius.
    radius = np.sqrt(surface.area / (2 * np.pi))
    return min(1.0, float(np.linalg.norm(base_of(surface) - surface.centroid)) / float(radius))


def apical_opening(surface: Surface) -> Opening | None:
    """Give the narrower of two openings that are at opposite ends: where an apex was cut off."""
    if len(surface.openings) != 2:
        return None
    one, other = surface.openings
    if (one.centre - surface.centroid) @ (other.centre - surface.centroid) >= 0:
        return None
    return other if radius_of(surface, one) >= radius_of(surface, other) else one


def base_openings(surface: Surface) -> tuple[Opening, ...]:
    """Give the openings of a cup but for that of an apex that was cut off."""
    cut = apical_opening(surface)
    return tuple(opening for opening in surface.openings if opening is not cut)


def base_of(surface: Surface) -> Floats:
    """Centroid of the base's openings by length, (3,)."""
    return mean_of(base_openings(surface))


def radius_of(surface: Surface, opening: Opening) -> float:
    """Mean distance of a rim from its centre: a jagged rim is longer, and no wider."""
    arms = surface.vertices[opening.vertices] - opening.centre
    return float(np.linalg.norm(arms, axis=1).mean())


def is_flat(surface: Surface) -> bool:
    """Whether the surface is a sheet: hardly thicker than nothing in one direction."""
    smallest, _, largest = np.maximum(np.linalg.eigh(surface.covariance)[0], 0.0)
    return bool(smallest < _FLAT**2 * largest)


# Triangles of a hemisphere miss at least this share of its area.
_HEMISPHERE = 0.05


def recognise(surface: Surface) -> tuple[Topology | None, str]:
    """Find the topology of a mesh, and the reason if there is none or it may be another."""
    reason = _obstacle(surface)
    if reason:
        return None, reason
    connectivity = surface.connectivity
    openings, genus = surface.openings, connectivity.genus
    if not openings and genus in (0.0, 1.0):
        return (SPHERE if genus == 0.0 else TORUS), ""
    if genus != 0.0:
        return None, f"The surface has handles ({connectivity.describe()})."
    if len(openings) == 1:
        if is_flat(surface):
            return (
                PLANE,
                "The surface is nearly flat and was taken for a plane; otherwise set topology=cup.",
            )
        if _is_shallow(surface):
            return CUP, (
                "The surface opens wider than a hemisphere and was taken for a cup; set "
                "topology=plane if it is a sheet that encloses nothing."
            )
        return CUP, ""
    towards = [opening.centre - surface.centroid for opening in openings]
    if len(openings) == 2 and towards[0] @ towards[1] < 0:
        return CYLINDER, ""
    base = mean_of(openings) - surface.centroid
    if axis_strength(surface) < FAINT_AXIS or any(arm @ base <= 0 for arm in towards):
        return None, f"Its {len(openings)} openings are not at one end."
    return CUP, ""


def require_fit(surface: Surface, stated: Topology) -> None:
    """Check that a stated topology is possible on a mesh.

    Raises
    ------
    TopologyError
        Naming the actual connectivity and the topologies that fit it.
    """
    if not len(surface.faces):
        raise errors.TopologyError(
            f"The topology was set to {stated}, but no edges join the {len(surface.vertices)} "
            "vertices.",
            remedy="Send triangles, or the lattice shape of the vertices (grid).",
        )
    connectivity = surface.connectivity
    n = len(surface.openings)
    reason = _obstacle(surface)
    possible: tuple[Topology, ...] = ()
    if not reason:
        if connectivity.genus == 0.0:
            possible = {0: (SPHERE,), 1: (CUP, PLANE), 2: (CYLINDER, CUP)}.get(n, (CUP,))
        elif connectivity.genus == 1.0 and n == 0:
            possible = (TORUS,)
    if stated in possible:
        return
    names = " or ".join(topology.name for topology in possible)
    raise errors.TopologyError(
        f"The topology was set to {stated}, but the mesh has {connectivity.describe()}. "
        f"{reason}".strip(),
        remedy=f"State {names}, or leave the topology out."
        if possible
        else "Leave the topology out: the mesh then gets the spring modes of its own connectivity.",
    )


def _is_shallow(surface: Surface) -> bool:
    """Whether the area is less than twice the span of the opening; a hemisphere's is twice.

    An opening spans the length of its vector area, which all surfaces that fill it share.
    """
    wound = surface.wound_faces
    if wound is None:
        return False
    a, b, c = triangles.corners_of(surface.vertices, wound)
    twice = np.cross(b - a, c - a).sum(axis=0)
    span = float(np.linalg.norm(twice)) / 2.0
    return surface.area < 2.0 * span * (1.0 - _HEMISPHERE)


def _obstacle(surface: Surface) -> str:
    """Why a mesh is not one surface with area; empty if it is."""
    connectivity = surface.connectivity
    if not len(surface.faces):
        return "There are no triangles."
    if len(connectivity.non_manifold_edges):
        a, b = connectivity.non_manifold_edges[0]
        return (
            f"{len(connectivity.non_manifold_edges)} edges belong to more than two triangles, the "
            f"first between vertices {a} and {b}."
        )
    if connectivity.n_components != 1:
        return f"The mesh falls into {connectivity.n_components} pieces."
    if len(connectivity.pinched):
        pinched = connectivity.pinched
        return f"Boundaries touch at {len(pinched)} vertices, first at {pinched[0]}."
    if connectivity.genus != int(connectivity.genus):
        return "The surface is one-sided."
    if not surface.area > 0:
        return "The surface has no area in the reference frame."
    return ""
