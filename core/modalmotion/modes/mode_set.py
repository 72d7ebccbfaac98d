"""Modes of one topology, in closed form: names, shapes and frequencies on a continuum.

The limit of fine lattices: the shapes solve (6) between the nodes too, and the frequencies are
those of (7) while waves are long. Equation numbers are those of Nastar (1994).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import (
    CLOSED,
    End,
    ModeLabel,
    Topology,
    half_periods,
    odd_at_pole,
    scales_of,
)
from modalmotion.representation import FrozenArrays, shown


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
        """Vertex that represents each in the triangles, (vertices,) int64."""


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


@shown("topology", "wavenumbers")
@dataclass(frozen=True, eq=False)
class ModeSet(FrozenArrays):
    """Modes of one topology, in order.

    Parameters
    ----------
    topology : Topology
    wavenumbers : (modes, axes) int64
    is_sine : (modes,) bool
        True for the sine of a pair.
    """

    topology: Topology
    wavenumbers: NDArray[np.int64]
    is_sine: NDArray[np.bool_]

    def __post_init__(self) -> None:
        self.wavenumbers.setflags(write=False)
        self.is_sine.setflags(write=False)

    def __len__(self) -> int:
        return len(self.is_sine)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ModeSet):
            return NotImplemented
        return self is other or (self._hash == other._hash and self._content == other._content)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(self._content)

    @cached_property
    def _content(self) -> tuple[Topology, tuple[int, ...], bytes, bytes]:
        # Arrays are compared a hundred times as slowly, and modes are the keys of caches.
        p, is_sine = self.wavenumbers, self.is_sine
        return self.topology, p.shape, p.astype(np.int64).tobytes(), is_sine.tobytes()

    @cached_property
    def labels(self) -> tuple[ModeLabel, ...]:
        """The modes' labels, in order."""
        return tuple(
            ModeLabel(tuple(p), "sin" if sine else "cos")
            for p, sine in zip(self.wavenumbers.tolist(), self.is_sine.tolist(), strict=True)
        )

    @cached_property
    def half_periods(self) -> NDArray[np.int64]:
        """Half periods of each shape along each axis, twice counted on non-closed axes.

        Returns
        -------
        (modes, axes) int64
            On a closed axis the signed number of whole periods p; on any other axis the
            integer h of cos(h pi s / 2) or sin(h pi s / 2).
        """
        return half_periods(self.topology, self.wavenumbers)

    @cached_property
    def is_odd_at_pole(self) -> NDArray[np.bool_]:
        """Whether the factor along each axis is the sine that vanishes at a pole.

        Returns
        -------
        (modes, axes) bool
        """
        return odd_at_pole(self.topology, self.wavenumbers)

    @cached_property
    def n_waves(self) -> NDArray[np.int64]:
        """Number of factors of each shape that vary; all closed axes count as one.

        Returns
        -------
        (modes,) int64
        """
        closed = list(self.topology.closed_axes)
        others = [i for i in range(self.topology.n_axes) if i not in closed]
        h = self.half_periods
        n_others = np.count_nonzero(h[:, others], axis=1)
        return np.asarray(n_others + (h[:, closed] != 0).any(axis=1), dtype=np.int64)

    @cached_property
    def extents(self) -> tuple[tuple[int, int], ...]:
        """Least and largest wavenumber along each axis; 0 and 0 without modes."""
        return tuple((int(p.min(initial=0)), int(p.max(initial=0))) for p in self.wavenumbers.T)

    @property
    def connectivity_id(self) -> str:
        """Empty: these modes belong to every mesh of the topology."""
        return ""

    @property
    def names(self) -> ModeSet:
        """These modes themselves: nothing had to be solved for."""
        return self

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Datasets of the modes in files."""
        return {"wavenumbers": self.wavenumbers, "is_sine": self.is_sine.astype(np.uint8)}

    def take(self, indices: NDArray[np.int64] | list[int] | slice) -> ModeSet:
        """Modes at these indices, in this order."""
        return ModeSet(self.topology, self.wavenumbers[indices], self.is_sine[indices])

    @staticmethod
    def of(topology: Topology, labels: tuple[ModeLabel, ...] | list[ModeLabel]) -> ModeSet:
        """Modes with these labels, in this order."""
        wavenumbers = np.array([label.wavenumbers for label in labels], dtype=np.int64)
        return ModeSet(
            topology,
            wavenumbers.reshape(len(labels), topology.n_axes),
            np.array([label.part == "sin" for label in labels], dtype=np.bool_),
        )

    def shapes_at(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Evaluate mode shapes Phi, the solutions of (6), at natural coordinates.

        Parameters
        ----------
        coordinates : (vertices, axes) float64
            s in [0, 1] on open and pole axes, theta in turns on closed ones.

        Returns
        -------
        (vertices, modes) float64
            Phi, each column with mean square 1 over the natural coordinates, on any surface
            that they map. At a pole every mode that turns about it is zero.
        """
        # (6) phi = scale * product over the axes of
        #     open:    cos(p pi s)
        #     closed:  cos or sin(2 pi p theta), of all closed axes together cos or sin(a + b)
        #     cup:     cos(r pi s) where p' is even, sin((r + 1/2) pi s) where it is odd
        #     sphere:  cos(r pi s) where p' is even, sin((r + 1) pi s) where it is odd
        # Many modes share a factor, which is worked out once.
        shapes = np.full((len(coordinates), len(self)), scales_of(self.n_waves))
        for axis, ends in enumerate(self.topology.ends):
            if ends == CLOSED:
                continue
            x = coordinates[:, axis, None]
            (h, odd), own = _each_once(self.half_periods[:, axis], self.is_odd_at_pole[:, axis])
            y = h * (np.pi / 2) * x
            shapes *= np.where(odd, np.sin(y), np.cos(y))[:, own]
            if End.POLE in ends:
                on_pole = x <= 0 if ends[1] != End.POLE else (x <= 0) | (x >= 1)
                turns = self.wavenumbers[:, axis + 1] != 0
                shapes[on_pole & turns] = 0.0
        closed = list(self.topology.closed_axes)
        if closed:
            (*periods, is_sine), own = _each_once(*self.half_periods.T[closed], self.is_sine)
            phase = np.zeros((len(coordinates), 1))
            for axis, p in zip(closed, periods, strict=True):
                phase = phase + 2 * np.pi * p * coordinates[:, axis, None]
            shapes *= np.where(is_sine, np.sin(phase), np.cos(phase))[:, own]
        return shapes

    def shapes_on(self, surface: Surface) -> NDArray[np.float64]:
        """Evaluate the shapes at the vertices of a surface, (vertices, modes) float64."""
        return self.shapes_at(surface.coordinates)

    def wavenumbers_on(self, lengths: tuple[float, ...]) -> NDArray[np.float64]:
        """Physical wavenumbers |k| on a surface with these axis lengths.

        Parameters
        ----------
        lengths : tuple of float
            Length along each axis (circumference on closed ones).

        Returns
        -------
        (modes,) float64, rad per length unit
        """
        k = np.zeros(len(self))
        for axis, ends in enumerate(self.topology.ends):
            half_turn = 2 * np.pi if ends == CLOSED else np.pi / 2
            # hypot, for the squares of very short lengths overflow.
            k = np.hypot(k, half_turn * self.half_periods[:, axis] / lengths[axis])
        return k

    def frequencies_on(self, surface: Surface, wave_speed: float) -> NDArray[np.float64]:
        """Angular frequencies w = c k, (modes,) float64, rad per s: see `Modes`."""
        finite = tuple(length if length > 0 else np.inf for length in surface.lengths)
        frequencies: NDArray[np.float64] = wave_speed * self.wavenumbers_on(finite)
        return frequencies

    def length_of(
        self,
        lengths: tuple[float, ...],
        angular_frequencies: NDArray[np.float64],  # noqa: ARG002 (springs need them)
        wave_speed: float,  # noqa: ARG002
    ) -> float:
        """Geometric mean of the lengths along the coordinates; 1 if one of them is zero."""
        if len(lengths) and min(lengths) > 0:
            return math.exp(sum(map(math.log, lengths)) / len(lengths))
        return 1.0


def _each_once(*columns: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Give different rows of columns once, a column each, and which of them each row is."""
    rows, own = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
    return rows.T, own.ravel()
