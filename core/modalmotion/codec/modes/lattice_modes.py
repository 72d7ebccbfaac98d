"""Closed-form modes of a lattice as an orthonormal transform of its nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.coder import read_varint, write_varint
from modalmotion.codec.fourier import (
    cosines,
    from_cosines,
    from_sines,
    odd_sines,
    sines,
    turn,
    turn_back,
)
from modalmotion.modes.order import require_shape
from modalmotion.modes.topology import CLOSED, OPEN, POLE_OPEN, POLE_POLE, Topology

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LATTICE: Final = 1
"""First byte of the section of these modes."""

ENDS: Final = (OPEN, CLOSED, POLE_OPEN, POLE_POLE)
"""Ends of an axis by their code in a stream."""


# Numbers of the rows that are transformed together.
_AT_ONCE: Final = 2**14


@dataclass(frozen=True, eq=False)
class LatticeModes:
    """The modes of a lattice, smoothest first.

    Products of one function an axis, orthonormal over the nodes. On a torus these are
    cos a cos b, ..., which span what cos(a + b), ... span.

    Parameters
    ----------
    topology : Topology
    shape : tuple of int
        Nodes along each axis.
    fineness : tuple of int
        One number from 1 to 255 for each axis, in proportion to 1 / its length: it decides the
        order of the modes and nothing else.
    """

    topology: Topology
    shape: tuple[int, ...]
    fineness: tuple[int, ...]

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Number of the product of each mode, row by row; by wavenumber, then by number."""
        key = np.zeros(self.shape, dtype=np.int64)
        for axis, (ends, n, fine) in enumerate(
            zip(self.topology.ends, self.shape, self.fineness, strict=True)
        ):
            quarter = _quarter_periods(ends == CLOSED, n)
            along = np.expand_dims(quarter, [a for a in range(len(self.shape)) if a != axis])
            if ends not in (OPEN, CLOSED):
                # Odd about the pole: a quarter period more on a cup, half a one on a sphere.
                odd = self._odd_at_pole(axis)
                along = along + odd * (1 if ends == POLE_OPEN else 2)
            key += (fine * along) ** 2
        return np.argsort(key.ravel(), kind="stable")

    def analyse(self, values: Floats) -> Floats:
        """Values at the nodes to coefficients, (rows, nodes) to (rows, modes)."""
        array = values.reshape(-1, *self.shape)
        for axis in self._axes():
            array = self._along(array, axis, inverse=False)
        return array.reshape(len(values), -1)[:, self.order]

    def synthesise(self, coefficients: Floats, where: Ints | None = None) -> Floats:
        """Coefficients to values, (rows, first modes) to (rows, nodes), or some of these."""
        n_rows, n_modes = coefficients.shape
        n_nodes = prod(self.shape)
        n_values = n_nodes if where is None else len(where)
        values, places = np.empty((n_rows, n_values)), self.order[:n_modes]
        # A few rows at once: what stands between the steps stays in the cache, and in memory that
        # the process has already.
        n_at_once = max(1, _AT_ONCE // n_nodes)
        for start in range(0, n_rows, n_at_once):
            rows = slice(start, start + n_at_once)
            flat = np.zeros((len(values[rows]), n_nodes))
            flat[:, places] = coefficients[rows]
            array = flat.reshape(-1, *self.shape)
            for axis in reversed(self._axes()):
                array = self._along(array, axis, inverse=True)
            found = array.reshape(-1, n_nodes)
            values[rows] = found if where is None else found[:, where]
        return values

    @property
    def shaken(self) -> None:
        """None: no solver decides these modes."""
        return

    def pieces(self, largest: int) -> None:
        """None: they have no pieces."""

    def write(self) -> bytes:
        """Write which modes these are."""
        parts = [bytes([LATTICE, len(self.shape)])]
        for ends, n, fine in zip(self.topology.ends, self.shape, self.fineness, strict=True):
            parts += [bytes([ENDS.index(ends), fine]), write_varint(n)]
        return b"".join(parts)

    def _axes(self) -> list[int]:
        """List closed axes first: a pole axis depends on the turns around it."""
        ends = self.topology.ends
        return sorted(range(len(ends)), key=lambda axis: ends[axis] != CLOSED)

    def _odd_at_pole(self, axis: int) -> NDArray[np.int64]:
        """1 where the number of turns of the axis after this one is odd."""
        n = self.shape[axis + 1]
        turns = _quarter_periods(True, n) // 4
        others = [a for a in range(len(self.shape)) if a != axis + 1]
        return np.expand_dims(turns % 2, others)

    def _along(self, array: Floats, axis: int, *, inverse: bool) -> Floats:
        ends, place = self.topology.ends[axis], axis + 1
        if ends == CLOSED:
            return turn_back(array, place) if inverse else turn(array, place)
        even = (from_cosines if inverse else cosines)(array, place)
        if ends == OPEN:
            return even
        if ends == POLE_OPEN:
            odd = odd_sines(array, place)
        else:
            odd = (from_sines if inverse else sines)(array, place)
        return np.where(self._odd_at_pole(axis)[None] == 1, odd, even)


def read_lattice_modes(data: bytes, n_vertices: int) -> LatticeModes:
    """Read modes that `LatticeModes.write` wrote.

    Raises
    ------
    IndexError, ValueError
        If they make no sense, or are not those of so many vertices.
    """
    ends, shape, fineness, position = [], [], [], 2
    for _ in range(data[1]):
        ends.append(ENDS[data[position]])
        fineness.append(data[position + 1])
        n, position = read_varint(data, position + 2)
        shape.append(n)
    topology = Topology(tuple(ends))
    if prod(shape) != n_vertices or position != len(data):
        raise ValueError
    require_shape(topology, tuple(shape))
    return LatticeModes(topology, tuple(shape), tuple(fineness))


def _quarter_periods(closed: bool, n: int) -> NDArray[np.int64]:
    """Quarter periods along an axis of each of its functions."""
    index = np.arange(n)
    return 4 * ((index + 1) // 2) if closed else 2 * index
