"""How far the positions of a sequence may be off."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown


@shown("source", "between_frames")
@dataclass(frozen=True, eq=False)
class Uncertainty(FrozenArrays):
    """Error of each position: e = Phi c + d, smooth in modes of its own, and apart from them.

    Parameters
    ----------
    source : str
        What it comes from: "noise", "points" or "images".
    shapes : (vertices, modes) float64
        Phi; no modes where all errors are apart.
    across, along : (frames, 3 modes, 3 modes) float64, length unit squared
        Covariance of c as far as it moves the surface along its normals, and as far as it moves
        vertices along the surface, or anywhere. Row 3 j + i is mode j in direction i.
    rest : (frames,) float64, length unit
        Standard deviation of each coordinate of d.
    alike : (vertices,) float64
        Vertices, itself included, whose d is the same as that of each: 1 where it is its own.
    between_frames : float
        Correlation of the error in one frame with that in the next.
    volumes : (frames,) float64, length unit cubed, optional
        Standard deviation of the volume in each frame.
    volume_correlation : float
        Of the errors of the largest and of the smallest volume.
    papillary_volume : float, length unit cubed
        Muscle within the surface that does not count as cavity.
    notes : tuple of str
        Caveats of how the surface was found.
    """

    source: str
    shapes: NDArray[np.float64]
    across: NDArray[np.float64]
    along: NDArray[np.float64]
    rest: NDArray[np.float64]
    alike: NDArray[np.float64]
    between_frames: float = 0.0
    volumes: NDArray[np.float64] | None = None
    volume_correlation: float = 0.0
    papillary_volume: float = 0.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("shapes", "across", "along", "rest", "alike"):
            getattr(self, name).setflags(write=False)

    @staticmethod
    def of_noise(
        sd: float,
        n_frames: int,
        n_vertices: int,
        independent: float,
        between_frames: float = 0.0,
    ) -> Uncertainty:
        """Take noise of one standard deviation on all coordinates.

        Parameters
        ----------
        sd : float, length unit
        n_frames, n_vertices : int
        independent : float
            Vertices of independent noise that average like these.
        between_frames : float
            Correlation of a vertex's noise in one frame with that in the next.
        """
        nothing = np.zeros((n_frames, 0, 0))
        return Uncertainty(
            source="noise",
            shapes=np.zeros((n_vertices, 0)),
            across=nothing,
            along=nothing,
            rest=np.full(n_frames, sd),
            alike=np.full(n_vertices, n_vertices / max(independent, 1.0)),
            between_frames=between_frames,
        )


def difference_deviation(one: float, other: float, correlation: float) -> float:
    """Deviation of the difference of two numbers with these deviations and this correlation."""
    return math.sqrt(max(one**2 + other**2 - 2.0 * correlation * one * other, 0.0))
