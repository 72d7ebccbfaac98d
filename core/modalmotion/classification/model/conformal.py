"""Class sets that hold the true class with the requested frequency, class by class.

Vovk, Conditional validity of inductive conformal predictors, Machine Learning, 2013 (label-
conditional or Mondrian); the scores come from cross-validation, so that no case is lost (Vovk,
Cross-conformal predictors, Ann Math Artif Intell, 2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown

# Rounding of 1 - coverage.
_ROUNDING = 1e-9


@shown()
@dataclass(frozen=True, eq=False)
class Calibration(FrozenArrays):
    """Strangeness of held-out cases, 1 - (probability of the true class), by class.

    Parameters
    ----------
    scores : tuple of (cases,) float64
        One array for each class, in increasing order.
    """

    scores: tuple[NDArray[np.float64], ...]

    def __post_init__(self) -> None:
        for array in self.scores:
            array.setflags(write=False)

    def holds(self, probabilities: NDArray[np.float64], coverage: float) -> NDArray[np.bool_]:
        """Which classes are in the set.

        Parameters
        ----------
        probabilities : (cases, classes) float64
        coverage : float

        Returns
        -------
        (cases, classes) bool
            A class stays unless fewer than a share 1 - coverage of its n held-out cases and the
            case itself are as strange: (number as strange + 1) / (n + 1) > 1 - coverage.
        """
        alpha = 1.0 - coverage
        in_set = np.empty(probabilities.shape, dtype=np.bool_)
        for k, scores in enumerate(self.scores):
            n = len(scores)
            as_strange = n - np.searchsorted(scores, 1.0 - probabilities[:, k], side="left")
            in_set[:, k] = as_strange + 1 > alpha * (n + 1) + _ROUNDING
        return in_set

    def too_few(self, coverage: float) -> tuple[int, ...]:
        """Classes with fewer than 1 / (1 - coverage) - 1 cases, which every set must hold."""
        least = 1.0 / (1.0 - coverage) - 1.0
        return tuple(k for k, s in enumerate(self.scores) if len(s) < least - 1e-6)


def calibrate(
    probabilities: NDArray[np.float64], y: NDArray[np.int64], n_classes: int
) -> Calibration:
    """Keep the strangeness of held-out cases.

    Parameters
    ----------
    probabilities : (cases, classes) float64
    y : (cases,) int64
    n_classes : int
    """
    strange = 1.0 - probabilities[np.arange(len(y)), y]
    return Calibration(tuple(np.sort(strange[y == k]) for k in range(n_classes)))
