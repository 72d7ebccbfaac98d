"""Rotation between two sets of corresponding points, weighted.

Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Crystallographica A,
1976; Umeyama, Least-squares estimation of transformation parameters between two point patterns,
IEEE PAMI, 1991.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.representation import shown

# Relative to the largest singular value of the covariance: below this a direction is not
# spanned by the points, and the rotation about it is not determined by them. Singular values
# are squares of extents, so this is a thickness of a millionth.
RANK_TOLERANCE: Final = 1e-12

# How strongly an undetermined rotation is drawn to none at all; far below any determined one.
_PULL: Final = 1e-9


@shown()
@dataclass(frozen=True)
class Rotations:
    """Rotations that carry the reference onto each frame.

    Parameters
    ----------
    matrices : (frames, 3, 3) float64
        Proper rotations (determinant +1): position = matrix @ (reference position).
    is_determined : (frames,) bool
        False where the points of either set span less than a plane, or the best fit is not
        unique: the rotation is then the smallest of those that fit equally well.
    """

    matrices: NDArray[np.float64]
    is_determined: NDArray[np.bool_]

    @staticmethod
    def none(n_frames: int) -> Rotations:
        """Rotations of frames that are not turned."""
        return Rotations(np.tile(np.eye(3), (n_frames, 1, 1)), np.ones(n_frames, dtype=np.bool_))


def kabsch(
    covariances: NDArray[np.float64],
    tolerance: float = RANK_TOLERANCE,
    noise: NDArray[np.float64] | None = None,
) -> Rotations:
    """Best proper rotation for each covariance matrix.

    Parameters
    ----------
    covariances : (frames, 3, 3) float64, length unit squared
        sum w (x - centroid) (x_ref - centroid_ref)'.
    tolerance : float
        Smallest second singular value, relative to the first, that is not rounding.
    noise : (frames,) float64, length unit squared, optional
        Singular values up to this are rounding, for any size of the first one.

    Returns
    -------
    Rotations
    """
    largest = np.abs(covariances).max(axis=(1, 2), keepdims=True)
    scaled = covariances / np.where(largest > 0, largest, 1.0)
    matrices, S, sign = _nearest_rotations(scaled)
    # Unique iff the second singular value, with the sign of the third, is not zero:
    # s2 + sign s3 > 0 (Umeyama 1991).
    margin = S[:, 1] + sign * S[:, 2]
    is_determined = margin > tolerance * np.where(S[:, 0] > 0, S[:, 0], np.inf)
    if noise is not None:
        is_determined &= margin * largest[:, 0, 0] > noise
    loose = np.flatnonzero(~is_determined)
    if loose.size:
        # Of all that fit equally well the one nearest to none: the smallest turn.
        pulled = scaled[loose] + max(_PULL, 10 * tolerance) * np.eye(3)
        matrices[loose] = _nearest_rotations(pulled)[0]
        matrices[loose[S[loose, 0] == 0.0]] = np.eye(3)
    return Rotations(matrices, is_determined)


def _nearest_rotations(
    matrices: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Rotations R with the largest trace of R' C, singular values of C, sign of the last one."""
    # R = U diag(1, 1, det(U V')) V' for C = U S V': never a reflection.
    U, S, Vt = np.linalg.svd(matrices)
    sign = np.where(np.linalg.det(U) * np.linalg.det(Vt) < 0, -1.0, 1.0)
    U = U.copy()
    U[:, :, 2] *= sign[:, None]
    return U @ Vt, S, sign
