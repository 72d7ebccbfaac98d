"""Labels of modes: integer wavenumbers and a part, never a floating eigenvalue."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.separable import Separable, separate
from modalmotion.modes.topology import CLOSED, OPEN, POLE_OPEN, Topology
from modalmotion.representation import shown

# A wave has mean square 1/2 along each axis, or each wave vector of closed axes together.
_SCALES: Final = np.sqrt([1.0, 2.0, 4.0, 8.0])


class ModeLabel(NamedTuple):
    """Name of one mode.

    Parameters
    ----------
    wavenumbers : tuple of int
        One for each axis: counted from 0 on open and pole axes, the (signed) number of
        periods on closed ones.
    part : "cos" or "sin"
        Which of the two shapes of a wave vector; "cos" where there is only one.
    """

    wavenumbers: tuple[int, ...]
    part: Literal["cos", "sin"]

    def __str__(self) -> str:
        return f"({', '.join(map(str, self.wavenumbers))}, {self.part})"


@shown("topology", "wavenumbers")
@dataclass(frozen=True, eq=False)
class ModeSet:
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
        return self is other or (
            self.topology == other.topology
            and np.array_equal(self.wavenumbers, other.wavenumbers)
            and np.array_equal(self.is_sine, other.is_sine)
        )

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.topology, self.wavenumbers.tobytes(), self.is_sine.tobytes()))

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
        """Number of factors of each shape that are no constant, all closed axes together one.

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
        """Least and largest wavenumber along each axis; 0 and 0 of no modes."""
        return tuple((int(p.min(initial=0)), int(p.max(initial=0))) for p in self.wavenumbers.T)

    @cached_property
    def separable(self) -> Separable:
        """The modes as sums of products of one function per axis."""
        return separate(self.topology, self.half_periods, self.is_odd_at_pole, self.is_sine)

    @cached_property
    def coefficients(self) -> NDArray[np.float64]:
        """Sign of each term of `separable` times the scale of its mode on a continuum.

        Returns
        -------
        (terms,) float64
        """
        return self.separable.signs * scales_of(self.n_waves)[self.separable.mode]

    def take(self, indices: NDArray[np.int64] | list[int] | slice) -> ModeSet:
        """Modes at the given indices, in that order."""
        return ModeSet(self.topology, self.wavenumbers[indices], self.is_sine[indices])

    @staticmethod
    def of(topology: Topology, labels: tuple[ModeLabel, ...] | list[ModeLabel]) -> ModeSet:
        """Modes with the given labels, in that order."""
        wavenumbers = np.array([label.wavenumbers for label in labels], dtype=np.int64)
        return ModeSet(
            topology,
            wavenumbers.reshape(len(labels), topology.n_axes),
            np.array([label.part == "sin" for label in labels], dtype=np.bool_),
        )


def scales_of(n_waves: NDArray[np.int64]) -> NDArray[np.float64]:
    """Factors that give shapes with so many waves mean square 1, (modes,) float64."""
    scales: NDArray[np.float64] = _SCALES[n_waves]
    return scales


def odd_at_pole(topology: Topology, wavenumbers: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Where a pole axis carries the sine family: the closed axis after it has odd p'."""
    odd = np.zeros(wavenumbers.shape, dtype=np.bool_)
    for axis, ends in enumerate(topology.ends):
        if ends not in (OPEN, CLOSED):
            odd[:, axis] = wavenumbers[:, axis + 1] % 2 == 1
    return odd


def half_periods(topology: Topology, wavenumbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Half periods along each axis: see `ModeSet.half_periods`."""
    odd = odd_at_pole(topology, wavenumbers)
    h = wavenumbers.copy()
    for axis, ends in enumerate(topology.ends):
        if ends == CLOSED:
            continue
        # open: cos(p pi s). cup: cos(r pi s), sin((r + 1/2) pi s).
        # sphere: cos(r pi s), sin((r + 1) pi s).
        h[:, axis] = 2 * wavenumbers[:, axis]
        h[:, axis] += odd[:, axis] * (1 if ends == POLE_OPEN else 2)
    return h
