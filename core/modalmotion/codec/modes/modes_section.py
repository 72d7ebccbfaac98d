"""Modes as the header of a stream names them."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.coder import damaged, parsing
from modalmotion.codec.modes.lattice_modes import LATTICE, read_lattice_modes
from modalmotion.codec.modes.patch_modes import SPRINGS, read_patch_modes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STORED: Final = b"\x00"

_UNKNOWN: Final = "This decoder does not know the modes of the stream."


class OrthonormalModes(Protocol):
    """A basis of the vertices, orthonormal or nearly so, smoothest modes first."""

    def analyse(self, values: Floats) -> Floats:
        """Values to coefficients, (rows, vertices) to (rows, modes)."""

    def synthesise(self, coefficients: Floats, where: Ints | None = None) -> Floats:
        """Coefficients of the first modes to values, (rows, modes) to (rows, vertices).

        At some vertices only if they are stated; what they do not need is not solved for.
        """

    @property
    def shaken(self) -> OrthonormalModes | None:
        """The same modes with errors larger than rounding; None where none are solved for."""

    def pieces(self, largest: int) -> list[Ints] | None:
        """Vertices of the pieces of the connectivity; None where the modes do not know it."""

    def write(self) -> bytes:
        """Write which modes these are, and a probe of those that are solved for."""


def read_modes(
    data: bytes, n_vertices: int, faces: Ints, n_threads: int = 1, *, whole: bool = True
) -> OrthonormalModes:
    """Make the modes that a stream names, with so many threads; not all at once unless whole.

    Raises
    ------
    MalformedFileError
        If they make no sense, or are not those of the encoder.
    LimitError
        If solving for them would take too long.
    """
    with parsing(_UNKNOWN):
        if data[0] == LATTICE:
            return read_lattice_modes(data, n_vertices)
        if data[0] == SPRINGS:
            return read_patch_modes(data, n_vertices, faces, n_threads, whole=whole)
    raise damaged(_UNKNOWN)
