"""Planes: slices in any orientation, and sets of them that show one moment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.images.geometry import are_missing, require_affine, require_samples
from modalmotion.images.interpolation import interpolated
from modalmotion.images.volume import Volume
from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown


@shown("values", "spacing", "thickness")
@dataclass(frozen=True, eq=False)
class Plane(FrozenArrays):
    """An image I[i, j] on a plane in space.

    Parameters
    ----------
    values : (i, j) array of real numbers
        As they are stored: not copied. NaN where nothing is known.
    affine : (4, 3) or (3, 3) float64, mm
        From indices to LPS coordinates of the pixels' middles.
    thickness : float, mm
        Of the slice, which a pixel is the mean over.
    """

    values: NDArray[Any]
    affine: NDArray[np.float64]
    thickness: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", require_samples(self.values, 2))
        object.__setattr__(self, "affine", require_affine(self.affine, 2))
        if not (np.isfinite(self.thickness) and self.thickness > 0):
            raise ParameterError(
                f"A slice is {self.thickness} mm thick.", remedy="Give a thickness above zero."
            )

    @property
    def spacing(self) -> tuple[float, float]:
        """Distance from pixel to pixel along each axis, mm."""
        i, j = np.linalg.norm(self.affine[:, :2], axis=0).tolist()
        return i, j

    @property
    def origin(self) -> NDArray[np.float64]:
        """Middle of the first pixel, (3,) float64, mm."""
        return self.affine[:, 2]

    @cached_property
    def normal(self) -> NDArray[np.float64]:
        """Unit vector across the plane, (3,) float64."""
        across = np.cross(self.affine[:, 0], self.affine[:, 1])
        unit: NDArray[np.float64] = across / np.linalg.norm(across)
        return unit

    @cached_property
    def _inverse(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.pinv(self.affine[:, :2]), dtype=np.float64)

    @cached_property
    def _are_missing(self) -> bool:
        return are_missing(self.values)

    def heights(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of points (n, 3) above the plane, (n,) float64, mm."""
        heights: NDArray[np.float64] = (points - self.origin) @ self.normal
        return heights

    def indices(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn the feet of points (n, 3), mm, to indices (n, 2)."""
        found: NDArray[np.float64] = (points - self.origin) @ self._inverse.T
        return found

    def sample(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Interpolate at the feet of points (n, 3), mm, on the plane; NaN outside the image."""
        return interpolated(self.values, self.indices(points), are_missing=self._are_missing)


@shown("planes")
@dataclass(frozen=True, eq=False)
class PlaneSet:
    """Planes that show one moment: short and long axis together.

    Parameters
    ----------
    planes : tuple of Plane
    """

    planes: tuple[Plane, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "planes", tuple(self.planes))
        if not self.planes or not all(isinstance(plane, Plane) for plane in self.planes):
            raise ShapeError("A set of planes needs one plane or more.", remedy="Give planes.")

    def __len__(self) -> int:
        return len(self.planes)


def slices_of(volume: Volume) -> PlaneSet:
    """Take a volume of thick slices apart into planes, across its coarsest axis."""
    axis = int(np.argmax(volume.spacing))
    others = [i for i in range(3) if i != axis]
    step, columns = volume.affine[:, axis], volume.affine[:, others]
    normal = np.cross(columns[:, 0], columns[:, 1])
    thickness = abs(float(step @ normal) / float(np.linalg.norm(normal)))
    planes = []
    # Views: nothing of the volume is copied.
    for k, values in enumerate(np.moveaxis(volume.values, axis, 0)):
        origin = volume.affine[:, 3] + k * step
        affine = np.column_stack([columns, origin])
        planes.append(Plane(values, affine, thickness))
    return PlaneSet(tuple(planes))
