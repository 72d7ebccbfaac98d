"""Interface of modes of every kind, known in closed form or solved for."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.label import ModeLabel
from modalmotion.modes.topology import Topology


class Surface(Protocol):
    """Properties of a surface that modes need; a template has them."""

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """Natural coordinates, (vertices, axes) float64: see `ModeSet.shapes_at`."""

    @property
    def lengths(self) -> tuple[float, ...]:
        """Length along each axis, length unit."""

    @property
    def vertices(self) -> NDArray[np.float64]:
        """Positions, (vertices, 3) float64, length unit."""

    @property
    def faces(self) -> NDArray[np.int64]:
        """Triangles, (faces, 3) int64."""

    @property
    def representatives(self) -> NDArray[np.int64]:
        """Vertex that stands for each in the triangles, (vertices,) int64."""


class Modes(Protocol):
    """Modes in an order, by name: equal, with equal hashes, where their names are."""

    @property
    def topology(self) -> Topology | None:
        """None for modes that belong to one mesh."""

    @property
    def connectivity_id(self) -> str:
        """Sha256 in hex of the edges of the one mesh whose amplitudes compare; empty for all."""

    @property
    def wavenumbers(self) -> NDArray[np.int64]:
        """Numbers of the labels, (modes, axes) int64."""

    @property
    def is_sine(self) -> NDArray[np.bool_]:
        """True for the sine of a pair, (modes,) bool."""

    @property
    def labels(self) -> tuple[ModeLabel, ...]:
        """The modes' labels, in order."""

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Datasets of the modes in files."""

    @property
    def names(self) -> Modes:
        """The modes as a result stores them: without shapes that had to be solved for."""

    def __len__(self) -> int: ...

    def __hash__(self) -> int: ...

    def take(self, indices: NDArray[np.int64]) -> Modes:
        """Modes at these indices, in this order.

        Raises
        ------
        ParameterError
            If their order is fixed, and this one differs.
        """

    def shapes_on(self, surface: Surface) -> NDArray[np.float64]:
        """Evaluate the shapes at the vertices of a surface, (vertices, modes) float64."""

    def frequencies_on(self, surface: Surface, wave_speed: float) -> NDArray[np.float64]:
        """Angular frequencies in the limit of long waves, w = c k.

        Parameters
        ----------
        surface : Surface
        wave_speed : float, length unit per s

        Returns
        -------
        (modes,) float64, rad per s
        """

    def length_of(
        self,
        lengths: tuple[float, ...],
        angular_frequencies: NDArray[np.float64],
        wave_speed: float,
    ) -> float:
        """Length that amplitudes compare with; 1 where the surface has none.

        Parameters
        ----------
        lengths : tuple of float, length unit
            Of the surface, along each axis.
        angular_frequencies : (modes,) float64, rad per s
            As `frequencies_on` gave them.
        wave_speed : float, length unit per s
        """


def wave_pairs(modes: Modes) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the cosine and the sine of each wave vector.

    Returns
    -------
    cosines, sines : (waves,) int64
        In the order of the cosines; the sine is -1 where there is none.
    """
    wavenumbers = list(map(tuple, modes.wavenumbers.tolist()))
    cosines = np.flatnonzero(~modes.is_sine)
    sine_of = {wavenumbers[k]: k for k in np.flatnonzero(modes.is_sine).tolist()}
    sines = [sine_of.get(wavenumbers[k], -1) for k in cosines.tolist()]
    return cosines, np.array(sines, dtype=np.int64)


def whole_counts(modes: Modes) -> NDArray[np.int64]:
    """Numbers of first modes that split no cosine-sine pair, increasing, the last one included."""
    return np.append(np.flatnonzero(~modes.is_sine[1:]) + 1, len(modes))
