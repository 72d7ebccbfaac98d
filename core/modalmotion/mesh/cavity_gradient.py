"""Gradients of the volume of a cavity by its vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.cavity import Cavity


def volume_gradient(cavity: Cavity, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differentiate the volume by each vertex, (vertices, 3) float64, length unit squared."""
    x = x - x[cavity.faces[0, 0]]
    total = np.zeros_like(x)
    for k in range(3):
        b, c = (x[cavity.faces[:, (k + i) % 3]] for i in (1, 2))
        np.add.at(total, cavity.faces[:, k], np.cross(b, c) / 6.0)
    return total + _of_lids(cavity, x)


def lid_gradient(cavity: Cavity, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differentiate the volume by where the lids of openings are, (vertices, 3) float64.

    As if the wall went along: what is swept by each lid where its rim moves.
    """
    total = np.zeros_like(x)
    for edges in cavity.openings:
        middle = x[edges[:, 0]].mean(axis=0)
        start, end = x[edges[:, 0]] - middle, x[edges[:, 1]] - middle
        # A triangle sweeps its area vector times the mean of what its corners move by.
        areas = np.cross(end, start) / 6.0
        np.add.at(total, edges[:, 0], areas)
        np.add.at(total, edges[:, 1], areas)
        total[edges[:, 0]] += areas.sum(axis=0) / len(edges)
    return total


def _of_lids(cavity: Cavity, x: NDArray[np.float64]) -> NDArray[np.float64]:
    total = np.zeros_like(x)
    for edges in cavity.openings:
        start, end = x[edges[:, 0]], x[edges[:, 1]]
        centre = start.mean(axis=0)
        np.add.at(total, edges[:, 1], np.cross(start, centre) / 6.0)
        np.add.at(total, edges[:, 0], np.cross(centre, end) / 6.0)
        total[edges[:, 0]] += np.cross(end, start).sum(axis=0) / 6.0 / len(edges)
    return total
