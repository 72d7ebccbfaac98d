"""Transforms of displacements on lattices: to modal amplitudes and back."""

from modalmotion.modes.all_modes import project_all, superpose_all
from modalmotion.modes.few_modes import (
    project,
    project_with,
    superpose,
    superpose_with,
)

__all__ = ["project", "project_all", "project_with", "superpose", "superpose_all", "superpose_with"]
