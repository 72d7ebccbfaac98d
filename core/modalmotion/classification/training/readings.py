"""In which of its readings each training case is taken."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import READINGS
from modalmotion.classification.model.domain import domain_shape

# Times that the readings are chosen anew from the classes they gave.
_N_ROUNDS: Final = 5


def best_readings(
    values: NDArray[np.float64], y: NDArray[np.int64], n_classes: int
) -> NDArray[np.float64]:
    """Features in the reading that is nearer to the case's own class, found by turns.

    Cases are taken to be right-handed, so only the inward side is unknown.
    """
    if values.shape[1] == 1:
        return values[:, 0]
    both = values[:, [k for k, reading in enumerate(READINGS) if not reading.is_mirrored]]
    X = both[:, 0]
    for _ in range(_N_ROUNDS):
        centre, scale = X.mean(axis=0), np.where(X.std(axis=0) > 0, X.std(axis=0), np.inf)
        means, whitening = domain_shape((X - centre) / scale, y, n_classes)
        apart = ((both - centre) / scale - means[y][:, None]) @ whitening
        nearest = (apart**2).sum(axis=2).argmin(axis=1)
        X = both[np.arange(len(both)), nearest]
    return X
