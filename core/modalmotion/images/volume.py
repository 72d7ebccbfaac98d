"""Volumes: samples on an oblique lattice in space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.images.geometry import are_missing, require_affine, require_samples
from modalmotion.images.interpolation import interpolated
from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown


@shown("values", "spacing")
@dataclass(frozen=True, eq=False)
class Volume(FrozenArrays):
    """An image I[i, j, k] in space.

    Parameters
    ----------
    values : (i, j, k) array of real numbers
        As they are stored: not copied. NaN where nothing is known.
    affine : (4, 4) or (3, 4) float64, mm
        From indices to LPS coordinates of the voxels' middles. Sheared and left-handed ones are
        as good as others.

    Raises
    ------
    ShapeError
        If the samples are no real numbers along three axes.
    ParameterError
        If the affine is not finite or flat.
    """

    values: NDArray[Any]
    affine: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", require_samples(self.values, 3))
        object.__setattr__(self, "affine", require_affine(self.affine, 3))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels along each axis."""
        i, j, k = self.values.shape
        return i, j, k

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Distance from voxel to voxel along each axis, mm."""
        i, j, k = np.linalg.norm(self.affine[:, :3], axis=0).tolist()
        return i, j, k

    @cached_property
    def _are_missing(self) -> bool:
        return are_missing(self.values)

    @cached_property
    def _inverse(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(self.affine[:, :3]), dtype=np.float64)

    def indices(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn points (n, 3), mm, to indices (n, 3)."""
        found: NDArray[np.float64] = (points - self.affine[:, 3]) @ self._inverse.T
        return found

    def sample(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Interpolate at points (n, 3), mm; NaN outside."""
        return interpolated(self.values, self.indices(points), are_missing=self._are_missing)

    def extents(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far a voxel reaches along unit vectors (n, 3): (n,) float64, mm."""
        steps = np.linalg.norm(self.affine[:, :3], axis=0)
        along = directions @ (self.affine[:, :3] / steps)
        extents: NDArray[np.float64] = np.linalg.norm(along * steps, axis=1)
        return extents
