"""Corrections: whole steps that bring single coordinates back within the guaranteed error."""

from __future__ import annotations

import numpy as np

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.bits.entropy import Coder, Ints, code_count, code_numbers, code_signs


def code_corrections(coder: Coder, shape: tuple[int, ...], corrections: Ints | None) -> Ints:
    """Code corrections: how many, the gaps between them, their sizes and signs.

    Parameters
    ----------
    coder : Writer or Reader
    shape : (frames, 3, vertices)
    corrections : (frames, 3, vertices) int64, optional
        For a writer.

    Raises
    ------
    MalformedFileError
        If values are corrected that do not exist.
    """
    n_values = int(np.prod(shape))
    flat = None if corrections is None else corrections.ravel()
    places = None if flat is None else np.flatnonzero(flat)
    values = None if flat is None or places is None else flat[places]
    n = code_count(coder, None if places is None else len(places), n_values)
    gaps = None if places is None else np.diff(places, prepend=-1) - 1
    places = np.cumsum(code_numbers(coder, n, gaps) + 1) - 1
    more = code_numbers(coder, n, None if values is None else np.abs(values) - 1)
    signs = code_signs(coder, n, values)
    if n and not 0 <= int(places.max()) < n_values:
        raise damaged(f"The stream corrects a value outside of {n_values}.")
    steps = np.zeros(n_values, dtype=np.int64)
    steps[places] = signs * (more + 1)
    return steps.reshape(shape)
