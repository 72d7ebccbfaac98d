"""Transforms of displacements on lattices: to modal amplitudes and back."""

from modalmotion.transform.few_modes import (
    project,
    project_with,
    superpose,
    superpose_with,
)
from modalmotion.transform.full import project_all, superpose_all

__all__ = ["project", "project_all", "project_with", "superpose", "superpose_all", "superpose_with"]
