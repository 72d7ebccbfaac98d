"""What a user should know of a template: notes on its mesh and on its landmarks."""

from __future__ import annotations

from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.surface import Surface


def notes_on_mesh(surface: Surface) -> list[str]:
    """Say what of a mesh has no part in its surface."""
    found = surface.connectivity
    notes = []
    if len(found.isolated):
        notes.append(
            f"{len(found.isolated)} vertices belong to no triangle (first: {found.isolated[0]}); "
            "they have no weight."
        )
    if len(found.degenerate):
        notes.append(
            f"{len(found.degenerate)} triangles name a vertex twice (first: face "
            f"{found.degenerate[0]}); they were left out."
        )
    return notes


def notes_on_landmarks(found: Coordinates) -> list[str]:
    """Say which landmarks the shape leaves open."""
    if found.landmarks is None:
        return []
    meaning = {
        "axis": "The direction of the axis",
        "apex": "Which end is the apex",
        "base": "Which end is the base",
        "theta_zero": "The zero of theta",
        "start": "Which corner s and t start from",
    }
    weak = [meaning[name] for name in found.landmarks.weak if name in meaning]
    notes = [f"{name} is not determined by the shape; give it as a landmark." for name in weak]
    if "theta_zero" in found.landmarks.weak and found.topology.closed_axes:
        notes[-1] += " Cosine and sine of a pair can only be compared together."
    return notes
