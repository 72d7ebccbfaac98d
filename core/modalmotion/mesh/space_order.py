"""An order of points in which neighbours in space are near in memory too."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# Of each axis; three of them fit into 64.
_BITS: Final = 21

# Two zeros are put before each bit by halving the distance of groups of bits, again and again
# (Morton, A computer oriented geodetic data base, IBM, 1966).
_SPREAD: Final = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def space_order(positions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Order points along a Morton curve.

    Parameters
    ----------
    positions : (n, 3) float64
        Finite.

    Returns
    -------
    (n,) int64
        Points in their order; those at one place stay in theirs.
    """
    if not len(positions):
        return np.zeros(0, dtype=np.int64)
    return np.argsort(space_codes(positions, _BITS), kind="stable")


def space_codes(positions: NDArray[np.float64], n_bits: int) -> NDArray[np.uint64]:
    """Places along a Morton curve.

    Parameters
    ----------
    positions : (n, 3) float64
        Finite; at least one.
    n_bits : int
        Of each axis, up to 21.

    Returns
    -------
    (n,) uint64
        Below 2^(3 n_bits).
    """
    low = positions.min(axis=0)
    span = float((positions.max(axis=0) - low).max()) or 1.0
    steps = ((positions - low) * ((2**n_bits - 1) / span)).astype(np.uint64)
    code = np.zeros(len(positions), dtype=np.uint64)
    for axis in range(3):
        bits = np.ascontiguousarray(steps[:, axis])
        for shift, mask in _SPREAD:
            bits |= bits << np.uint64(shift)
            bits &= np.uint64(mask)
        code |= bits << np.uint64(axis)
    return code
