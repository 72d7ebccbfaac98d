"""The shape that displacements are measured from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.rigid import RANK_TOLERANCE
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.products import weighted_sum
from modalmotion.numeric.scale import power_of_two

# Relative rounding of sums over thousands of vertices.
_ROUNDING: Final = 1e-13

# Sizes between these need no scaling: their squares are ordinary numbers.
_SMALLEST: Final = 2.0**-200
_LARGEST: Final = 2.0**200


@dataclass(frozen=True, eq=False)
class ReferenceShape:
    """The shape that displacements are measured from, centred.

    Parameters
    ----------
    centre : (3,) float64, length unit
        Weighted centroid.
    rest : (3, vertices) float64, in units of `scale`
        Positions from it.
    weights : (vertices,) float64
        Shares that add up to 1.
    scale : float, length unit
        A power of two; 1 unless the surface is so large or small that squares would
        overflow or vanish.
    tolerance : float
        Of `kabsch`: the thickness that rounding of the stored positions gives to a line.
    ignored : (n,) int64
        Vertices that are not read here: in no triangle.
    """

    centre: NDArray[np.float64]
    rest: NDArray[np.float64]
    weights: NDArray[np.float64]
    scale: float
    tolerance: float
    ignored: NDArray[np.int64]

    @cached_property
    def spread(self) -> float:
        """Root mean square distance from the centroid, in units of the scale."""
        return float(np.sqrt((self.weights * (self.rest**2).sum(axis=0)).sum()))

    def noise(self, drift: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bound the rounding of covariances of frames that drifted so far, (frames,)."""
        far: NDArray[np.float64] = np.sqrt((drift**2).sum(axis=1))
        return _ROUNDING * self.spread * far

    @cached_property
    def moments(self) -> NDArray[np.float64]:
        """Columns that sum positions x to sum w x x_ref' and to sum w x, (vertices, 4)."""
        return np.concatenate([self.rest * self.weights, self.weights[None]]).T

    @staticmethod
    def at(
        sequence: MeshSequence,
        weights: NDArray[np.float64],
        start: NDArray[np.float64],
        ignored: NDArray[np.int64] | None = None,
    ) -> ReferenceShape:
        """Centre positions (vertices, 3) that a sequence is measured from."""
        ignored = np.zeros(0, dtype=np.int64) if ignored is None else ignored
        counted = weights > 0
        centre = weighted_sum(weights, start)
        rest = np.ascontiguousarray(start.T - centre[:, None])
        tolerance = _rank_tolerance(sequence, counted, centre, rest)
        scale = _scale(sequence, counted, centre)
        rest[:, ignored] = 0.0
        return ReferenceShape(centre, rest / scale, weights, scale, tolerance, ignored)


def _scale(
    sequence: MeshSequence, counted: NDArray[np.bool_], centre: NDArray[np.float64]
) -> float:
    """Power of two that brings every counted offset from the centre to 1 or below, or 1."""
    positions = sequence.vertices if counted.all() else sequence.vertices[:, counted]
    low, high = float(positions.min()), float(positions.max())
    largest = max(high - float(centre.min()), float(centre.max()) - low)
    if largest == 0.0 or _SMALLEST < largest < _LARGEST:
        return 1.0
    return power_of_two(largest)


def _rank_tolerance(
    sequence: MeshSequence,
    counted: NDArray[np.bool_],
    centre: NDArray[np.float64],
    rest: NDArray[np.float64],
) -> float:
    """Square of the thickness that rounding of the stored positions gives to a line."""
    extent = float(np.abs(rest[:, counted]).max(initial=0.0))
    if extent == 0.0:
        return RANK_TOLERANCE
    largest = float(np.abs(centre).max()) + extent
    step = float(np.finfo(sequence.vertices.dtype).eps) * largest / extent
    return max(RANK_TOLERANCE, (4 * step) ** 2)
