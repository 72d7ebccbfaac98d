"""Caveats of a template: notes on its mesh and on its landmarks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import Topology
from modalmotion.numerals import counted
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.landmarks import LANDMARKS_ON
from modalmotion.template.surface import Surface


def notes_on_merging(representatives: NDArray[np.int64]) -> list[str]:
    """Say how many vertices others stand for: see `Template.representatives`."""
    others = np.flatnonzero(representatives != np.arange(len(representatives)))
    if not len(others):
        return []
    n = counted(len(others), "vertex", "vertices")
    text = (
        f"{n} of {len(representatives)} coincide with an earlier one in every frame (first: vertex "
        f"{others[0]} with {representatives[others[0]]}) and were merged with it; amplitudes and "
        "errors speak of all that were sent. merge_vertices = false (--no-merge-vertices) leaves "
        "them apart."
    )
    return [text]


def notes_on_mesh(surface: Surface, isolated: NDArray[np.int64]) -> list[str]:
    """Name the parts of a mesh outside its surface.

    Parameters
    ----------
    surface : Surface
    isolated : (n,) int64
        Vertices in no triangle.
    """
    degenerate, repeated = surface.connectivity.degenerate, surface.connectivity.repeated
    notes = []
    if len(isolated):
        notes.append(
            f"{len(isolated)} vertices belong to no triangle (first: {isolated[0]}); "
            "they have no weight in the fit, and are moved as the nearest vertex of the surface."
        )
    if len(degenerate):
        notes.append(
            f"{len(degenerate)} triangles name a vertex twice (first: face "
            f"{degenerate[0]}); they were left out."
        )
    if len(repeated):
        notes.append(
            f"{counted(len(repeated), 'triangle')} repeat an earlier one (first: face "
            f"{repeated[0]}) and count once."
        )
    return notes


def note_on_border(cover: float, border: float) -> str:
    """Say that the kind of a closed surface's modes is nearly the other."""
    return (
        f"The kind of modes is near its border: the coordinates of a sphere cover this surface "
        f"{cover:.2f} times, and below {border:g} it has the springs of its own mesh. Another "
        "recording of it may have the other kind; where several are compared, name one template "
        "or state one topology, sphere or mesh, for all."
    )


def notes_on_landmarks(coordinates: Coordinates) -> list[str]:
    """Name the landmarks that the shape does not determine."""
    if coordinates.landmarks is None:
        return []
    meaning = {
        "axis": "The direction of the axis",
        "apex": "Which end is the apex",
        "base": "Which end is the base",
        "theta_zero": "The zero of theta",
        "start": "Which corner s and t start from",
    }
    weak = [name for name in coordinates.landmarks.weak if name in meaning]
    notes = [
        f"{meaning[name]} is not determined by the shape; state "
        f"{places_wanted(coordinates.topology, name)}."
        for name in weak
    ]
    if "theta_zero" in coordinates.landmarks.weak and coordinates.topology.closed_axes:
        notes[-1] += " Cosine and sine of a pair can only be compared together."
    return notes


def places_wanted(topology: Topology, weak: str = "axis") -> str:
    """Name the landmarks that settle a weak one, and the option that states them."""
    used = LANDMARKS_ON.get(topology.name, ())
    wanted = [weak] if weak in used else [name for name in used if name != "theta_zero"]
    if weak == "axis":
        wanted = [name for name in used if name in ("apex", "base")]
    names = " and ".join(wanted)
    kind = "landmark" if len(wanted) == 1 else "landmarks"
    return f"the {kind} {names} (--landmark {wanted[0]}=PLACE)" if wanted else "another topology"
