"""Columns of a feature table, and the table of one sequence."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Column:
    """One feature.

    Parameters
    ----------
    name : str
    modes : tuple of int
        Indices of the modes whose amplitudes it reads.
    """

    name: str
    modes: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class MotionFeatures:
    """Features of one sequence.

    Parameters
    ----------
    columns : tuple of Column
    values : (readings, features) float64
        One row for each way in which the motion can be read.
    motion : float
        RMS of the deformation about its mean over time, as a share of the surface's size.
    smooth_share : float
        See `smooth_share`.
    """

    columns: tuple[Column, ...]
    values: NDArray[np.float64]
    motion: float
    smooth_share: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the features."""
        return tuple(column.name for column in self.columns)

    def beside(self, other: MotionFeatures) -> MotionFeatures:
        """Return these features followed by others, which have one reading."""
        repeated = np.broadcast_to(other.values, (len(self.values), other.values.shape[1]))
        values = np.concatenate([self.values, repeated], axis=1)
        return replace(self, columns=self.columns + other.columns, values=values)
