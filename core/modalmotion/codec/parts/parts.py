"""Parts that move as one: in each, positions are an affine map of one shape.

A part is a set of pieces of the connectivity. What a temporal component does to a part is a
combination of four functions of its vertices: the constant, and the coordinates of the shape,
made orthonormal in their order. So a limb that turns takes four numbers for each component, and
its details are told once, with the shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.coder import Coder, damaged

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

N_FUNCTIONS: Final = 4
MOST_PARTS: Final = 256
FLAT: Final = 1.0 / 64.0
"""Of the extent of a part: what less than this is left of a coordinate is no function."""


@dataclass(frozen=True, eq=False)
class Parts:
    """Which vertices move as one.

    Parameters
    ----------
    largest : int
        Vertices of the largest piece that parts are made of.
    pieces : list of (n,) int64
        Vertices of each piece, ascending; the pieces by their lowest.
    labels : (pieces,) int64
        Part of each piece.
    count : int
        Number of parts.
    """

    largest: int
    pieces: Sequence[Ints]
    labels: Ints
    count: int

    @cached_property
    def members(self) -> list[Ints]:
        """Vertices of each part, ascending."""
        owner = np.empty(sum(map(len, self.pieces)), dtype=np.int64)
        for piece, label in zip(self.pieces, self.labels.tolist(), strict=True):
            owner[piece] = label
        order = np.argsort(owner, kind="stable")
        return np.split(order, np.searchsorted(owner[order], np.arange(1, self.count)))

    def functions(self, shape: Floats) -> Floats:
        """Orthonormal functions of each part: the constant, and what x, y and z add.

        Parameters
        ----------
        shape : (3, vertices) float64

        Returns
        -------
        (4, vertices) float64
            Zero where a coordinate is, but for a 64th of the extent, a combination of those before.
        """
        found = np.zeros((N_FUNCTIONS, shape.shape[1]))
        for part in self.members:
            if len(part):
                found[:, part] = _orthonormal(shape[:, part])
        return found

    def spread(self, numbers: Floats, functions: Floats) -> Floats:
        """Combine functions, (rows, 4 x parts) to (rows, vertices); function slow, part fast."""
        values = np.empty((len(numbers), functions.shape[1]))
        for i, part in enumerate(self.members):
            values[:, part] = numbers[:, i :: self.count] @ functions[:, part]
        return values

    def gathered(self, values: Floats, functions: Floats) -> Floats:
        """Project on the functions, (rows, vertices) to (rows, 4 x parts)."""
        numbers = np.empty((len(values), N_FUNCTIONS * self.count))
        for i, part in enumerate(self.members):
            numbers[:, i :: self.count] = values[:, part] @ functions[:, part].T
        return numbers

    def apart(self, functions: Floats) -> Floats:
        """List the functions of all parts, (4 x parts, vertices); function slow, part fast."""
        rows = np.zeros((N_FUNCTIONS * self.count, functions.shape[1]))
        for i, part in enumerate(self.members):
            rows[i :: self.count, part] = functions[:, part]
        return rows


def code_labels(coder: Coder, n_pieces: int, count: int, labels: Ints | None) -> Ints:
    """Code the part of each piece: how many other parts came up since it last did.

    Parameters
    ----------
    coder : Coder
    n_pieces, count : int
        Pieces and parts.
    labels : (pieces,) int64, optional
        For a writer.

    Raises
    ------
    MalformedFileError
        If there is no such part.
    """
    latest = list(range(count))
    ranks = None
    if labels is not None:
        found = []
        for label in labels.tolist():
            found.append(latest.index(label))
            latest.insert(0, latest.pop(found[-1]))
        latest, ranks = list(range(count)), np.array(found, dtype=np.int64)
    ranks = coder.numbers(n_pieces, ranks)
    if n_pieces and ranks.max() >= count:
        raise damaged(f"The stream names part {ranks.max()} of {count}.")
    told = np.empty(n_pieces, dtype=np.int64)
    for i, rank in enumerate(ranks.tolist()):
        told[i] = label = latest.pop(rank)
        latest.insert(0, label)
    return told


def _orthonormal(shape: Floats) -> Floats:
    n = shape.shape[1]
    basis = np.zeros((N_FUNCTIONS, n))
    basis[0] = 1.0 / np.sqrt(n)
    centred = shape - shape.mean(axis=1, keepdims=True)
    extent = float(np.sqrt((centred**2).sum()))
    for j, coordinate in enumerate(centred, start=1):
        left = coordinate
        # Twice: once leaves rounding errors of what was taken off.
        for _ in range(2):
            left = left - (basis[:j] @ left) @ basis[:j]
        norm = float(np.sqrt((left**2).sum()))
        if norm > FLAT * extent:
            basis[j] = left / norm
    return basis
