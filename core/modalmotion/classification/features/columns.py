"""Columns of a feature table, and the table of one sequence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.representation import shown

# A motion so small has no kind; its logarithm is still a number.
_LEAST_MOTION: Final = 1e-12


@shown()
@dataclass(frozen=True)
class Column:
    """One feature.

    Parameters
    ----------
    name : str
    modes : tuple of int
        Indices of the modes whose amplitudes it reads.
    power : float
        Power of the size of the motion that it grows with: 1/2 for a root.
    """

    name: str
    modes: tuple[int, ...]
    power: float = 1.0


class Columns(tuple[Column, ...]):
    """Columns of one table, which are the keys of caches: their hash is worked out once."""

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"Columns(n={len(self)})"

    def __reduce__(self) -> tuple[type[Columns], tuple[tuple[Column, ...]]]:
        # Hashes of texts differ from process to process.
        return Columns, (tuple(self),)

    @cached_property
    def _hash(self) -> int:
        return super().__hash__()

    @cached_property
    def powers(self) -> NDArray[np.float64]:
        """Powers of all columns, (features,) float64."""
        powers = np.array([column.power for column in self])
        powers.setflags(write=False)
        return powers


class MotionValues(NamedTuple):
    """`MotionFeatures` without the names."""

    values: NDArray[np.float64]
    motion: float
    smooth_share: float


@shown()
@dataclass(frozen=True, eq=False)
class MotionFeatures:
    """Features of one sequence.

    Parameters
    ----------
    columns : Columns
    values : (readings, features) float64
        One row for each way in which the motion can be read.
    motion : float
        RMS of the deformation about its mean over time, as a share of the surface's size.
    smooth_share : float
        See `smooth_share`.
    """

    columns: Columns
    values: NDArray[np.float64]
    motion: float
    smooth_share: float

    @property
    def kinds(self) -> NDArray[np.float64]:
        """Kind and size of the motion: see `kind_of`, (readings, features + 1)."""
        return kind_of(self.values, self.motion, self.columns.powers)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the features."""
        return tuple(column.name for column in self.columns)


def kind_of(
    values: NDArray[np.float64], motions: NDArray[np.float64] | float, powers: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Tell what motions are like from how large they are.

    Two motions of one kind, one twice as large as the other, differ in the last column alone.

    Parameters
    ----------
    values : (..., features) float64, percent of the size
    motions : (...) float64 or float
        `MotionFeatures.motion` of each; one for all that are readings of one motion.
    powers : (features,) float64

    Returns
    -------
    (..., features + 1) float64
        Features over the motion's size, and the logarithm of that size.
    """
    kinds: NDArray[np.float64] = np.empty((*values.shape[:-1], values.shape[-1] + 1))
    if isinstance(motions, float):
        motion = max(motions, _LEAST_MOTION)
        np.divide(values, (100.0 * motion) ** powers, out=kinds[..., :-1])
        kinds[..., -1] = math.log(motion)
        return kinds
    m = np.maximum(motions, _LEAST_MOTION)[..., None]
    np.divide(values, (100.0 * m) ** powers, out=kinds[..., :-1])
    kinds[..., -1:] = np.log(m)
    return kinds
