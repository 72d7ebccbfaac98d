"""Decoded positions as whole numbers, the same everywhere.

Positions are sums of floating-point products, and their last bits depend on the processor,
the libraries and the number of threads. So they are rounded to multiples of a quantum, far
finer than the target error. Only a value within the uncertainty of half-way between two
multiples could be rounded either way: the encoder lists those with its choices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.coder import Coder, damaged

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Guards:
    """Values near half-way between two multiples of the quantum, and how they were rounded.

    Parameters
    ----------
    places : (guards,) int64
        Ascending, counted over (frame, direction, vertex).
    up : (guards,) int64
        1 where the value was rounded up.
    """

    places: Ints
    up: Ints

    def round(self, scaled: Floats) -> Ints:
        """Round to whole numbers, (frames, 3, vertices) int64."""
        # In the order of the places, whatever that of the values in memory: a view, not a copy.
        whole = np.rint(scaled).astype(np.int64, order="C")
        flat = whole.reshape(-1)
        flat[self.places] = np.floor(scaled.reshape(-1)[self.places]).astype(np.int64) + self.up
        return whole

    def within(self, shape: tuple[int, int, int], where: Ints) -> Guards:
        """Those of some vertices, in the order of these.

        Parameters
        ----------
        shape : (int, int, int)
            Frames, directions, and vertices of all.
        where : (n,) int64
        """
        place = np.full(shape[2], -1, dtype=np.int64)
        place[where] = np.arange(len(where))
        vertex = place[self.places % shape[2]]
        there = vertex >= 0
        row = self.places[there] // shape[2]
        return Guards(row * len(where) + vertex[there], self.up[there])


def find_guards(scaled: Floats, uncertainty: float) -> Guards:
    """List what two computations could round differently.

    Parameters
    ----------
    scaled : (frames, 3, vertices) float64
        In quanta.
    uncertainty : float
        Quanta by which another computation may differ.
    """
    flat = scaled.reshape(-1)
    places = np.flatnonzero(np.abs(flat - np.floor(flat) - 0.5) < uncertainty)
    near = flat[places]
    return Guards(places, (np.rint(near) > np.floor(near)).astype(np.int64))


def code_guards(coder: Coder, n_values: int, guards: Guards | None) -> Guards:
    """Code the list.

    Raises
    ------
    MalformedFileError
        If it names values that do not exist.
    """
    n = coder.count(None if guards is None else len(guards.places), n_values)
    width = max(1, n_values.bit_length())
    places = coder.bits(n, width, None if guards is None else guards.places)
    up = coder.bits(n, 1, None if guards is None else guards.up)
    if len(places) and (places.max() >= n_values or (np.diff(places) <= 0).any()):
        raise damaged(f"The stream lists a value outside of {n_values}, or out of order.")
    return Guards(places, up)


def code_corrections(coder: Coder, shape: tuple[int, ...], corrections: Ints | None) -> Ints:
    """Code whole steps that bring single coordinates back within the guaranteed error.

    How many there are, the gaps between them, their sizes and signs.

    Parameters
    ----------
    coder : Coder
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
    n = coder.count(None if places is None else len(places), n_values)
    gaps = None if places is None else np.diff(places, prepend=-1) - 1
    places = np.cumsum(coder.numbers(n, gaps) + 1) - 1
    more = coder.numbers(n, None if values is None else np.abs(values) - 1)
    signs = coder.signs(n, values)
    if n and not 0 <= int(places.min()) <= int(places.max()) < n_values:
        raise damaged(f"The stream corrects a value outside of {n_values}.")
    steps = np.zeros(n_values, dtype=np.int64)
    steps[places] = signs * (more + 1)
    return steps.reshape(shape)
