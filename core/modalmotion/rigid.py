"""Rotation between two sets of corresponding points, weighted (Kabsch 1976, Umeyama 1991)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Relative to the largest singular value of the covariance: below this a direction is not
# spanned by the points, and the rotation about it is not determined by them.
_RANK_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Rotations:
    """Rotations that carry the reference onto each frame.

    Parameters
    ----------
    matrices : (frames, 3, 3) float64
        Proper rotations (determinant +1): position = matrix @ (reference position).
    is_determined : (frames,) bool
        False where the points of either set span less than a plane, or the best fit is not
        unique: the rotation is then one of several that fit equally well.
    """

    matrices: NDArray[np.float64]
    is_determined: NDArray[np.bool_]


def kabsch(
    covariances: NDArray[np.float64],
) -> Rotations:
    """Best proper rotation for each covariance matrix.

    Parameters
    ----------
    covariances : (frames, 3, 3) float64, length unit squared
        sum w (x - centroid) (x_ref - centroid_ref)'.

    Returns
    -------
    Rotations
    """
    # R = U diag(1, 1, det(U V')) V' for covariance = U S V': never a reflection.
    largest = np.abs(covariances).max(axis=(1, 2), keepdims=True)
    scaled = covariances / np.where(largest > 0, largest, 1.0)
    U, S, Vt = np.linalg.svd(scaled)
    sign = np.sign(np.linalg.det(U @ Vt))
    U = U.copy()
    U[:, :, 2] *= sign[:, None]
    # Unique iff the second singular value, with the sign of the third, is not zero:
    # s2 + sign s3 > 0 (Umeyama 1991).
    margin = S[:, 1] + sign * S[:, 2]
    is_determined = margin > _RANK_TOLERANCE * np.where(S[:, 0] > 0, S[:, 0], 1.0)
    matrices = U @ Vt
    matrices[S[:, 0] == 0.0] = np.eye(3)
    return Rotations(matrices, is_determined)
