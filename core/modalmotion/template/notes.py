"""Caveats of a template: notes on its mesh and on its landmarks."""

from __future__ import annotations

from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.surface import Surface


def notes_on_mesh(surface: Surface) -> list[str]:
    """Name the parts of a mesh outside its surface."""
    isolated, degenerate = surface.connectivity.isolated, surface.connectivity.degenerate
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
    return notes


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
    weak = [meaning[name] for name in coordinates.landmarks.weak if name in meaning]
    notes = [f"{name} is not determined by the shape; give it as a landmark." for name in weak]
    if "theta_zero" in coordinates.landmarks.weak and coordinates.topology.closed_axes:
        notes[-1] += " Cosine and sine of a pair can only be compared together."
    return notes
