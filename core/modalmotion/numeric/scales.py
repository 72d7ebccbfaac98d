"""Norms, quantiles and factors of arrays of any scale."""

import numpy as np

from modalmotion.representation import Floats


def orthonormal(A: Floats) -> tuple[Floats, Floats]:
    """Q and R of a matrix, the diagonal of R not negative: a basis has one sign."""
    Q, R = np.linalg.qr(A)
    signs = np.where(np.diag(R) < 0, -1.0, 1.0)
    return Q * signs, R * signs[:, None]


def inverse_of_cholesky(A: Floats) -> Floats:
    """Inverse L^-1 of the lower triangle L with L L' = A.

    Raises
    ------
    numpy.linalg.LinAlgError
        If A is not positive definite.
    """
    return np.asarray(np.linalg.inv(np.linalg.cholesky(A)))


def gram(inverse: Floats) -> Floats:
    """A^-1 of L^-1, exactly symmetric."""
    full = inverse.T @ inverse
    return np.asarray((full + full.T) / 2)


def power_of_two(size: float) -> float:
    """Give a power of two just above a size: dividing by it is exact, and squares do not overflow.

    Parameters
    ----------
    size : float
        0 or more.

    Returns
    -------
    float
        Between 2^-1000 and 2^1000; 1 for 0.
    """
    return 1.0 if size == 0.0 else float(2.0 ** np.clip(np.frexp(size)[1], -1000, 1000))


def lengths(vectors: Floats) -> Floats:
    """Lengths of vectors, none too large or too small to be squared.

    Parameters
    ----------
    vectors : (..., 1 or 3) float64

    Returns
    -------
    (...) float64
    """
    if vectors.shape[-1] == 1:
        return np.abs(vectors[..., 0])
    return np.asarray(np.hypot(np.hypot(vectors[..., 0], vectors[..., 1]), vectors[..., 2]))


def root_mean_square(values: Floats) -> float:
    """Root mean square without overflow of the squares."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    shares = values / largest
    shares *= shares
    return largest * float(np.sqrt(np.add.reduce(shares, axis=None) / shares.size))


def exceeded_by_a_twentieth(values: Floats) -> Floats:
    """Smallest value in each row that at most a twentieth of the row exceeds.

    Parameters
    ----------
    values : (rows, n) float64

    Returns
    -------
    (rows,) float64
    """
    n = values.shape[1]
    place = n - 1 - n // 20
    return np.asarray(np.partition(values, place, axis=1)[:, place])
