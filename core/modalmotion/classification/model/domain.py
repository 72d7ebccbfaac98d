"""The domain of a model: how far a case may be from the training cases."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import FeatureReader
from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown

# Shares of the least motion and smoothness in training that a case must reach; and the highest
# such limits, for cohorts that all move a great deal.
_SHARE_OF_LEAST: Final = 0.5
_LEAST_MOTION: Final = 0.003
_LEAST_SMOOTH: Final = 0.5

# Shrinkage towards independent features where there are many cases.
_LEAST_SHRINKAGE: Final = 1e-2

# With too few cases for the requested share, the farthest one times this is the limit.
_MARGIN: Final = 1.5


@shown()
@dataclass(frozen=True, eq=False)
class Domain(FrozenArrays):
    """Where the training cases lie.

    It has a reader of its own, so that it does not depend on the features that tell classes apart.

    Parameters
    ----------
    reader : FeatureReader
        Of its columns; without a typical motion.
    means : (classes, columns) float64
        Of what motions are like and how large they are: see `kind_of`.
    whitening : (columns, columns) float64
        |(kind - mean) @ whitening| is the distance in standard deviations within a class
        (Mahalanobis), over the root of the number of columns.
    limit : float
        Distance from every class beyond which a motion is unlike any of the training.
    least_motion : float
        Deformation, as a share of the surface's size, below which nothing moves.
    least_smooth : float
        Smooth share below which a motion is noise.
    """

    reader: FeatureReader
    means: NDArray[np.float64]
    whitening: NDArray[np.float64]
    limit: float
    least_motion: float
    least_smooth: float

    def __post_init__(self) -> None:
        self.means.setflags(write=False)
        self.whitening.setflags(write=False)

    def distance(self, kinds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance to the nearest class, (cases,) float64, of kinds (cases, columns)."""
        # |W'k - W'm|^2 for all classes at once.
        a, (b, b_squares) = kinds @ self.whitening, self._white_means
        squares = np.einsum("ij,ij->i", a, a)[:, None] + b_squares - 2.0 * a @ b.T
        distances: NDArray[np.float64] = np.sqrt(np.maximum(squares.min(axis=1), 0.0))
        return distances

    @cached_property
    def _white_means(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        b = self.means @ self.whitening
        return b, np.einsum("ij,ij->i", b, b)


def domain_shape(
    z: NDArray[np.float64], y: NDArray[np.int64], n_classes: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Class means, and the whitening of the shrunk covariance within classes."""
    n, d = z.shape
    counts = np.bincount(y, minlength=n_classes)
    sums = np.zeros((n_classes, d))
    np.add.at(sums, y, z)
    means = sums / np.maximum(counts, 1)[:, None]
    apart = z - means[y]
    S = apart.T @ apart / n
    variances = np.diag(S)
    known = np.where(variances > 0, variances, 1.0)
    # With fewer cases than features nothing is known of most directions.
    share = max(_LEAST_SHRINKAGE, d / (n + d))
    S = (1.0 - share) * S + share * np.diag(known)
    L = np.linalg.cholesky(S)
    whitening: NDArray[np.float64] = np.linalg.inv(L).T / np.sqrt(d)
    return means, whitening


def domain_limit(held_out: NDArray[np.float64], known_share: float) -> float:
    """Distance that a share of new cases stays within.

    Parameters
    ----------
    held_out : (cases,) float64
        Distances of cases from a domain that they did not take part in.
    known_share : float
    """
    n = len(held_out)
    # The k-th of n is exceeded by a new one with probability 1 - k / (n + 1).
    rank = int(np.ceil(known_share * (n + 1) - 1e-9))
    ordered = np.sort(held_out)
    return float(ordered[rank - 1]) if rank <= n else float(_MARGIN * ordered[-1])


def motion_limits(
    motions: NDArray[np.float64], smooth_shares: NDArray[np.float64]
) -> tuple[float, float]:
    """Least motion and least smooth share, from those of the training cases."""
    return (
        min(_LEAST_MOTION, _SHARE_OF_LEAST * float(motions.min())),
        min(_LEAST_SMOOTH, _SHARE_OF_LEAST * float(smooth_shares.min())),
    )
