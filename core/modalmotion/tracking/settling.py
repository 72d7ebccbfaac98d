"""The amplitudes of one frame at which data and prior are in balance.

a = argmin sum w (n . (y - x(a)))^2 / s^2 + a' K a: the place where the oscillators of (3), driven
by the force that the data exert, come to rest. Gauss-Newton goes there in a few steps, each of
which matches points and surface anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.cholesky import gram, inverse_of_cholesky
from modalmotion.numeric.products import product
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.information import Information, information
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame

_MOST_STEPS: Final = 12

# A step of a tenth of the standard deviation in each amplitude, squared.
_SMALL: Final = 0.01


@dataclass(frozen=True, eq=False)
class Settled:
    """A frame at rest.

    Parameters
    ----------
    amplitudes : (modes, 3) float64, length unit
    information : Information
        About the shape before the last step.
    covariance : (3 modes, 3 modes) float64, length unit squared
        (A + K)^-1.
    """

    amplitudes: NDArray[np.float64]
    information: Information
    covariance: NDArray[np.float64]


def settle(
    surface: Deformable,
    frame: Frame,
    start: NDArray[np.float64],
    variances: NDArray[np.float64],
    noise: Noise,
    most_steps: int = _MOST_STEPS,
) -> Settled:
    """Find the equilibrium of one frame by Gauss-Newton.

    Parameters
    ----------
    surface : Deformable
    frame : Frame
    start : (modes, 3) float64, length unit
    variances : (modes,) float64, length unit squared
        K^-1.
    noise : Noise
    most_steps : int
    """
    stiffness = np.repeat(1.0 / variances, 3)
    a = start
    for _ in range(most_steps):
        found = information(surface, a, frame, noise)
        H = found.matrix + np.diag(stiffness)
        inverse = inverse_of_cholesky(H)
        new = product(
            np.ascontiguousarray(inverse.T), product(inverse, found.vector[:, None])
        ).reshape(-1, 3)
        change = (new - a).ravel()
        a = new
        if float(change @ product(H, change[:, None])[:, 0]) <= _SMALL * len(change):
            break
    return Settled(a, found, gram(inverse))
