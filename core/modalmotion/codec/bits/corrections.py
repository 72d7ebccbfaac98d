"""Corrections: whole steps that bring single coordinates back within the guaranteed error."""

from __future__ import annotations

import numpy as np

from modalmotion.codec.bits.entropy import Coder, Ints, code_numbers
from modalmotion.errors import MalformedFileError


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
    count = None if places is None else np.array([len(places)])
    n = int(code_numbers(coder, 1, count)[0])
    if n > n_values:
        raise MalformedFileError(
            f"The stream corrects {n} of {n_values} values.",
            remedy="The stream is damaged: send it again.",
        )
    gaps = None if places is None else np.diff(places, prepend=-1) - 1
    places = np.cumsum(code_numbers(coder, n, gaps) + 1) - 1
    more = code_numbers(coder, n, None if values is None else np.abs(values) - 1)
    negative = coder.bits(
        np.ones(n, dtype=np.int64), None if values is None else (values < 0).astype(np.int64)
    )
    if n and not 0 <= int(places.max()) < n_values:
        raise MalformedFileError(
            f"The stream corrects a value outside of {n_values}.",
            remedy="The stream is damaged: send it again.",
        )
    found = np.zeros(n_values, dtype=np.int64)
    found[places] = (1 - 2 * negative) * (more + 1)
    return found.reshape(shape)
