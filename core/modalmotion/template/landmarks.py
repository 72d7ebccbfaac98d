"""Natural coordinates, the landmarks that place them, and the notes on both."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.mesh.facts import CORNERS, landmark_of, require_vertex
from modalmotion.modes.topologies import CLOSED, Topology
from modalmotion.notes import Note
from modalmotion.representation import Floats, shown
from modalmotion.template.surfaces import Surface

# Below this a direction from an integral turns by more than a few degrees when the same
# surface is triangulated anew, and is called weak.
WEAK = 0.01


@shown()
@dataclass(frozen=True)
class GivenLandmarks:
    """Landmarks that the sender states instead of leaving them to the shape; all optional.

    Parameters
    ----------
    apex : int or (x, y, z), optional
        Where the axis starts. On a sphere it names the pole at which s is 0.
    base : int or (x, y, z), optional
        Where the axis ends. On a cylinder it names the opening at which s is 1.
    theta_zero : int or (x, y, z), optional
        A place with theta = 0, away from the axis; the start of a closed curve.
    corners : four of int or (x, y, z), optional
        Of a plane: (s, t) = (0, 0), (1, 0), (1, 1), (0, 1), in this order.
    """

    apex: mesh.Place | None = None
    base: mesh.Place | None = None
    theta_zero: mesh.Place | None = None
    corners: mesh.Corners | None = None

    def __post_init__(self) -> None:
        for name in self.names:
            object.__setattr__(self, name, landmark_of(name, getattr(self, name)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the stated landmarks."""
        return tuple(f.name for f in fields(self) if getattr(self, f.name) is not None)

    def as_json(self) -> dict[str, Any]:
        """Stated landmarks, for headers and answers."""
        return {name: getattr(self, name) for name in self.names}

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> "GivenLandmarks":
        """Read the output of `as_json`, lists for tuples."""
        return GivenLandmarks(**values)


def landmarks_in(
    facts: mesh.Facts, landmarks: GivenLandmarks, topology: Topology | None, *, is_lattice: bool
) -> GivenLandmarks:
    """Landmarks that a template reads: first those stated, then those of the facts.

    Parameters
    ----------
    facts : Facts
    landmarks : GivenLandmarks
        Override those of the facts.
    topology : Topology or None
        None where the connectivity has yet to decide: then any may be read.
    is_lattice : bool
        Its rows and columns place its coordinates, and no landmark does.

    Returns
    -------
    GivenLandmarks
        Without those facts that this topology has no use for; they stand for other results.
    """
    names = [f.name for f in fields(GivenLandmarks)]
    if topology is not None:
        names = list(LANDMARKS_ON.get(topology.name, ()))
    stated = {name: facts.landmarks[name] for name in names if name in facts.landmarks}
    if is_lattice or not stated:
        return landmarks
    return GivenLandmarks(**{**stated, **landmarks.as_json()})


@shown("strengths", "given", "n_loops")
@dataclass(frozen=True, eq=False)
class Landmarks:
    """Where the natural coordinates sit, each from integrals unless stated.

    Parameters
    ----------
    origin : (3,) float64, length unit
        Area centroid (length centroid of a curve), or its foot on a stated axis.
    axis : (3,) float64
        Unit vector from the apex end to the base end.
    theta_zero : (3,) float64
        Unit vector across the axis in which theta is 0; theta is right-handed about the axis.
    apex, base : (3,) float64, length unit
        Centres of the two ends: of the cap around the pole, of an opening.
    strengths : mapping of str to float
        How well the shape determines "axis", "apex", "base" and "theta_zero": 0 where
        another would do as well, 1 where there is no doubt or it was stated.
    n_loops : int
        Boundary loops of the mesh.
    given : tuple of str
        Names of those that the sender stated.
    """

    origin: Floats
    axis: Floats
    theta_zero: Floats
    apex: Floats
    base: Floats
    strengths: Mapping[str, float]
    n_loops: int
    given: tuple[str, ...] = ()

    @property
    def theta_zero_strength(self) -> float:
        """How well the zero of theta is determined, 0 to 1."""
        return self.strengths["theta_zero"]

    @property
    def weak(self) -> tuple[str, ...]:
        """Names of the landmarks that the shape does not determine."""
        return tuple(name for name, strength in self.strengths.items() if strength < WEAK)

    def placed(self, corner: Floats, scale: float) -> "Landmarks":
        """Return the same landmarks in other coordinates: scale * position + corner."""
        places = (self.origin, self.apex, self.base)
        origin, apex, base = (place * scale + corner for place in places)
        return replace(self, origin=origin, apex=apex, base=base)


LANDMARKS_ON: Final[dict[str, tuple[str, ...]]] = {
    "open curve": (),
    "closed curve": ("theta_zero",),
    "plane": ("corners",),
    "cylinder": ("apex", "base", "theta_zero"),
    "cup": ("apex", "base", "theta_zero"),
    "sphere": ("apex", "base", "theta_zero"),
    "torus": ("base", "theta_zero"),
}
"""Landmarks that each topology reads."""


def resolve_places(landmarks: GivenLandmarks, vertices: Floats) -> dict[str, Floats]:
    """Positions of the stated landmarks in the reference frame, (3,) or (4, 3), length unit.

    Raises
    ------
    ParameterError
        If a vertex does not exist.
    """
    positions = {}
    for name in landmarks.names:
        value = getattr(landmarks, name)
        places = value if name == CORNERS else (value,)
        for place in places:
            require_vertex(name, place, len(vertices))
        found = [vertices[p] if isinstance(p, int) else np.array(p) for p in places]
        positions[name] = np.stack(found) if name == CORNERS else found[0]
    return positions


def require_used(landmarks: GivenLandmarks, topology: Topology | None, *, is_lattice: bool) -> None:
    """Refuse landmarks that the topology has no use for, rather than ignore them.

    A lattice uses none: its rows and columns say where its coordinates are.

    Raises
    ------
    ParameterError
        Naming the landmark and those that would be used.
    """
    used = () if topology is None or is_lattice else LANDMARKS_ON.get(topology.name, ())
    for name in landmarks.names:
        if name not in used:
            surface = "surface without natural coordinates" if topology is None else topology.name
            if is_lattice:
                surface = "lattice, whose rows and columns place its coordinates"
            raise errors.ParameterError(
                f"The landmark '{name}' means nothing on a {surface}.",
                remedy=(f"Give {', '.join(used)}." if used else "Leave the landmarks out.")
                + " If it is among the facts of the sequence, remove it there.",
            )


def lattice_landmarks(
    surface: Surface, topology: Topology, coordinates: Floats
) -> Landmarks | None:
    """Axis along which s grows, and the direction in which theta is 0.

    Parameters
    ----------
    surface : Surface
        Nodes and the triangles between them.
    topology : Topology
    coordinates : (nodes, axes) float64

    Returns
    -------
    Landmarks or None
        None for lattices without one closed axis around another, or without area.

    Notes
    -----
    Theta runs as the columns do. Where that is left-handed about the axis, "theta_zero" is as
    the columns say and sines have the other sign than on a mesh.
    """
    if topology.n_axes != 2 or topology.ends[1] != CLOSED or topology.ends[0] == CLOSED:
        return None
    if not surface.area > 0:
        return None
    s, theta = coordinates.T
    share = surface.areas / surface.area
    centre = surface.centroid
    # The slope of position on s, and the first circular moment of position.
    slope = (share * (s - (share * s).sum())) @ surface.offsets
    length = float(np.linalg.norm(slope))
    spread = float(np.sqrt((share * (surface.offsets**2).sum(axis=1)).sum()))
    if not length > 1e-9 * spread:
        return None
    axis = slope / length
    zero = (share * np.cos(2 * np.pi * theta)) @ surface.offsets
    zero = zero - (zero @ axis) * axis
    reach = float(np.linalg.norm(zero))
    if not reach > 1e-9 * spread:
        return None
    low, high = s <= s.min(), s >= s.max()
    return Landmarks(
        origin=centre,
        axis=axis,
        theta_zero=zero / reach,
        apex=surface.vertices[low].mean(axis=0),
        base=surface.vertices[high].mean(axis=0),
        strengths={"axis": 1.0, "apex": 1.0, "base": 1.0, "theta_zero": 1.0},
        n_loops=len(surface.openings),
        given=("grid",),
    )


@shown("topology", "values", "notes")
@dataclass(frozen=True, eq=False)
class Coordinates:
    """Natural coordinates of one surface.

    Parameters
    ----------
    topology : Topology
    values : (vertices, axes) float64
        s from 0 to 1 on open and pole axes, theta in turns on closed ones.
    landmarks : Landmarks or None
        None where there is no axis.
    notes : tuple of Note
        Caveats for the user.
    """

    topology: Topology
    values: Floats
    landmarks: Landmarks | None
    notes: tuple[Note, ...] = ()
