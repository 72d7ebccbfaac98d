"""Transforms of displacements on lattices: to modal amplitudes and back."""

from modalmotion.modes.few_transform import (
    project,
    project_with,
    superpose,
    superpose_with,
)
from modalmotion.modes.full_transform import project_all, superpose_all

__all__ = ["project", "project_all", "project_with", "superpose", "superpose_all", "superpose_with"]
