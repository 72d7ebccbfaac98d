"""Digits that a model keeps."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# More would differ between numbers of threads.
_DIGITS: Final = 9


def rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round to so many significant digits that training again gives the same."""
    numbers = [float(f"{value:.{_DIGITS}g}") for value in np.ravel(values)]
    return np.array(numbers).reshape(np.shape(values))
