"""Sines and cosines of rational multiples of pi, reduced in integers first.

A float argument p (2n - 1) pi / 2N loses 6e-10 at N = 1e6; reduced as an integer it loses
nothing. Zeros and ones come out exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def cos_pi(numerator: NDArray[np.int64], denominator: int) -> NDArray[np.float64]:
    """cos(pi numerator / denominator).

    Parameters
    ----------
    numerator : (...) int64
    denominator : int
        Positive and below 2^60.

    Returns
    -------
    (...) float64
    """
    # cos is even with period 2, antisymmetric about 1/2: fold to [0, 1/2].
    k = numerator % (2 * denominator)
    k = np.minimum(k, 2 * denominator - k)
    above = 2 * k > denominator
    k = np.where(above, denominator - k, k)
    # The nearer of 0 and 1/2 is the origin, so that no argument exceeds pi / 4.
    from_half = denominator - 2 * k
    value = np.where(
        4 * k <= denominator,
        np.cos(np.pi * (k / denominator)),
        np.sin((np.pi / 2) * (from_half / denominator)),
    )
    return np.where(above, -value, value)


def sin_pi(numerator: NDArray[np.int64], denominator: int) -> NDArray[np.float64]:
    """sin(pi numerator / denominator), to full relative precision near every zero.

    Parameters
    ----------
    numerator : (...) int64
    denominator : int
        Positive and below 2^60.

    Returns
    -------
    (...) float64
    """
    k = numerator % (2 * denominator)
    below = k > denominator
    k = np.where(below, 2 * denominator - k, k)
    k = np.minimum(k, denominator - k)
    from_half = denominator - 2 * k
    value = np.where(
        4 * k <= denominator,
        np.sin(np.pi * (k / denominator)),
        np.cos((np.pi / 2) * (from_half / denominator)),
    )
    return np.where(below, -value, value)
