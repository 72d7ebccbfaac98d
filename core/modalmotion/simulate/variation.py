"""Smooth random vector fields: differences between individual hearts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_N_WAVES: Final = 32


@dataclass(frozen=True, eq=False)
class SmoothField:
    """A random vector field on the unit sphere, close to a Gaussian process.

    A sum of random cosines (Rahimi and Recht, Random features for large-scale kernel
    machines, NIPS, 2007), so it has all derivatives everywhere, the apex included.

    Parameters
    ----------
    wave_vectors : (waves, 3) float64
    phases : (waves,) float64, rad
    strengths : (waves, 3) float64, mm
    """

    wave_vectors: NDArray[np.float64]
    phases: NDArray[np.float64]
    strengths: NDArray[np.float64]

    def at(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Field vectors, (..., 3) float64, mm, at unit vectors (..., 3)."""
        values: NDArray[np.float64] = (
            np.cos(directions @ self.wave_vectors.T + self.phases) @ self.strengths
        )
        return values


def random_field(rms: float, length: float, rng: np.random.Generator) -> SmoothField:
    """Draw a field.

    Parameters
    ----------
    rms : float, mm
        Expected RMS length of its vectors.
    length : float
        Distance on the unit sphere over which the field forgets itself.
    rng : numpy.random.Generator
    """
    wave_vectors = rng.standard_normal((_N_WAVES, 3)) / length
    phases = rng.uniform(0.0, 2 * np.pi, _N_WAVES)
    strengths = rng.standard_normal((_N_WAVES, 3)) * rms * np.sqrt(2.0 / (3 * _N_WAVES))
    return SmoothField(wave_vectors, phases, strengths)
