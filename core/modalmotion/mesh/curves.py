"""Curves as lines of vertices: their steps, and the share of each vertex."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CLOSED_CURVE, OPEN_CURVE, Topology


def step_lengths(vertices: NDArray[np.float64], topology: Topology) -> NDArray[np.float64]:
    """Length from each vertex to the next; an open curve has one less than vertices."""
    ahead = np.roll(vertices, -1, axis=0) if topology == CLOSED_CURVE else vertices[1:]
    steps: NDArray[np.float64] = np.linalg.norm(ahead - vertices[: len(ahead)], axis=1)
    return steps


def curve_weights(vertices: NDArray[np.float64], topology: Topology) -> NDArray[np.float64]:
    """Half the length of the steps on either side of each vertex, (vertices,) float64."""
    steps = step_lengths(vertices, topology)
    if topology == OPEN_CURVE:
        steps = np.append(steps, 0.0)
    halves: NDArray[np.float64] = (steps + np.roll(steps, 1)) / 2
    return halves
