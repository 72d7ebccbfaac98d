"""Dampings that leave the modes uncoupled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError


def nodal_damping(coefficient: float, mass: float = 1.0) -> float:
    """Damping of every mode when each node moves through a viscous medium.

    Parameters
    ----------
    coefficient : float, force per velocity
        C at each node.
    mass : float
        M of one node.

    Returns
    -------
    float, 1 per time unit
        c = C / M, the same for all modes.

    Raises
    ------
    ParameterError
        If the coefficient is negative, the mass not positive, or one not finite.
    """
    if not (math.isfinite(coefficient) and coefficient >= 0 and math.isfinite(mass) and mass > 0):
        raise ParameterError(
            f"A damping of {coefficient} at nodes of mass {mass} does not damp.",
            remedy="Use a finite damping from zero on and a finite mass above zero.",
        )
    return coefficient / mass


def rayleigh_damping(
    angular_frequencies: NDArray[np.float64], alpha: float, beta: float
) -> NDArray[np.float64]:
    """Damping proportional to mass and to stiffness.

    Parameters
    ----------
    angular_frequencies : (modes,) float64, rad per time unit
    alpha : float, 1 per time unit
        Share of the mass matrix: all modes alike.
    beta : float, time units
        Share of the stiffness matrix: fast modes most.

    Returns
    -------
    (modes,) float64, 1 per time unit

    Raises
    ------
    ParameterError
        If alpha or beta is negative or not finite.

    Notes
    -----
    Rayleigh, The Theory of Sound, 1877, section 97.
    """
    if not all(math.isfinite(share) and share >= 0 for share in (alpha, beta)):
        raise ParameterError(
            f"Rayleigh damping with alpha = {alpha} and beta = {beta} would feed some modes.",
            remedy="Use finite values from zero on.",
        )
    w = np.asarray(angular_frequencies, dtype=np.float64)
    # c = alpha + beta w^2
    return alpha + beta * w**2
