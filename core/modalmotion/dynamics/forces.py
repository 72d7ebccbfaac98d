"""Forces at nodes, such as an image's, as forces on modes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.numeric.products import product


def modal_forces(
    shapes: NDArray[np.float64], forces: NDArray[np.float64], mass: float = 1.0
) -> NDArray[np.float64]:
    """Force on each mode per unit modal mass, the f = Phi' F of Nastar (1994), (3).

    On a lattice `modalmotion.modes.transform.project` does the same faster: f = project(F) / M.

    Parameters
    ----------
    shapes : (nodes, modes) float64
        Phi, each with mean square 1, as `Lattice.shapes` gives it.
    forces : (nodes, ...) float64, mass times mm per time unit squared
        F at each node, in as many directions as the caller has.
    mass : float
        M of one node.

    Returns
    -------
    (modes, ...) float64, mm per time unit squared
        The same bits on any number of threads.

    Raises
    ------
    ShapeError
        If there is not one force for each node.
    ParameterError
        If the mass is not positive and finite.
    """
    if shapes.ndim != 2 or len(forces) != len(shapes):
        raise ShapeError(
            f"Forces of shape {forces.shape} do not fit shapes of shape {shapes.shape}.",
            remedy="Give one force for each node.",
        )
    if not (math.isfinite(mass) and mass > 0):
        raise ParameterError(
            f"Nodes of mass {mass} cannot be accelerated.", remedy="Use a mass above zero."
        )
    # The shapes' mean square is 1, so Phi' M Phi = M N: f = Phi' F / (M N).
    phi, F = (np.asarray(a, dtype=np.float64) for a in (shapes, forces))
    f = product(phi.T, F.reshape(len(F), -1)) / (mass * len(phi))
    return f.reshape(phi.shape[1], *F.shape[1:])
