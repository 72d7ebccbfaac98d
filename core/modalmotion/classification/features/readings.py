"""One of the ways in which each motion can be read, for all motions alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.axis import READINGS

Array = NDArray[np.float64]

# Times that the readings are chosen anew from the centre that they gave.
_N_ROUNDS: Final = 5


def right_handed(values: Array) -> Array:
    """Take the readings in which theta runs right-handed, (1 or 2, features)."""
    if len(values) == 1:
        return values
    return values[[k for k, reading in enumerate(READINGS) if not reading.is_mirrored]]


def like_most(values: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Choose for each motion the reading that is most like those of the others.

    Parameters
    ----------
    values : sequence of (readings, features) float64

    Returns
    -------
    chosen : (motions, features) float64
    centre, scale : (features,) float64
        Mean and deviation that they were chosen by; the scale of what does not vary is infinite.
    """
    X = np.array([own[0] for own in values])
    for _ in range(_N_ROUNDS):
        spread = X.std(axis=0)
        centre = X.mean(axis=0)
        scale = np.where(spread > 1e-12 * np.abs(X).max(axis=0), spread, np.inf)
        X = np.array([nearest(own, centre, scale) for own in values])
    return X, centre, scale


def nearest(readings: Array, centre: Array, scale: Array) -> Array:
    """Take the reading that is nearest to a centre, (features,) float64."""
    apart = (((readings - centre) / scale) ** 2).sum(axis=1)
    own: Array = readings[int(apart.argmin())]
    return own
