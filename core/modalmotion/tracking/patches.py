"""How much of what the modes leave the places of a landmark have in common."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.tracking.deformable import Deformable


def alike_over(
    surface: Deformable,
    vertices: NDArray[np.int64],
    shares: NDArray[np.float64],
    n_values: float,
) -> float:
    """Variance of a mean over places, over that of one place, of what the modes leave.

    Parameters
    ----------
    surface : Deformable
    vertices : (n,) int64
    shares : (n,) float64
        Of each in the mean; they add up to 1.
    n_values : float
        Independent values of it on the whole surface.

    Returns
    -------
    float
        1 of one place, 1 / n_values of the whole surface: the middle of a ring is known better
        than a point, as the ring passes through several patches.

    Notes
    -----
    A correlation exp(-pi (d / l)^2) has the integral l^2 over a surface, and l along a curve. Of
    a mean over the whole surface, of the area A, it leaves l^2 / A, which is 1 / n_values:
    l^2 = A / n_values, of a curve l = L / n_values. Distances are those of the reference.
    """
    x = surface.template.vertices[vertices]
    squares = ((x[:, None] - x) ** 2).sum(axis=2)
    length = (surface.area / n_values) ** (1.0 / surface.template.topology.n_axes)
    alike = np.exp(-np.pi * squares / length**2)
    return float((shares[:, None] * shares * alike).sum())
