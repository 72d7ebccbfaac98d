"""Topologies, the ends of each axis of a surface, and the labels of their modes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError
from modalmotion.representation import shown


class End(StrEnum):
    """Boundary at one of the two ends of a chain of nodes."""

    OPEN = "open"
    CLOSED = "closed"
    POLE = "pole"


Ends = tuple[End, End]

OPEN: Final[Ends] = (End.OPEN, End.OPEN)
CLOSED: Final[Ends] = (End.CLOSED, End.CLOSED)
POLE_OPEN: Final[Ends] = (End.POLE, End.OPEN)
POLE_POLE: Final[Ends] = (End.POLE, End.POLE)

MESH: Final = "mesh"
"""In place of a topology's name: a surface whose modes are those of springs along its edges."""

_AXIS_NAMES: Final[dict[Ends, str]] = {
    OPEN: "open",
    CLOSED: "closed",
    POLE_OPEN: "pole-open",
    POLE_POLE: "pole-pole",
}


@shown("name")
@dataclass(frozen=True)
class Topology:
    """The tuple of ends of a surface's axes: a product of chains.

    A pole axis closes up over the axis that follows it, which must be closed: its first
    node at angle theta is joined to its first node at theta + pi.

    Parameters
    ----------
    ends : tuple of (End, End)
        Ends of each axis, one to three axes.

    Raises
    ------
    TopologyError
        If there are no axes or more than three, an axis mixes ends that cannot meet, or a
        pole axis is not followed by a closed one.
    """

    ends: tuple[Ends, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.ends) <= 3:
            raise TopologyError(
                f"A topology has one to three axes, not {len(self.ends)}.",
                remedy="Give one pair of ends for each axis.",
            )
        for axis, ends in enumerate(self.ends):
            if ends not in _AXIS_NAMES:
                raise TopologyError(
                    f"Axis {axis} has the ends {ends[0]} and {ends[1]}, which cannot be joined.",
                    remedy="Use open, closed, pole-open or pole-pole.",
                )
            if End.POLE in ends and self.ends[axis + 1 : axis + 2] != (CLOSED,):
                raise TopologyError(
                    f"Axis {axis} has a pole, but the axis after it is not closed.",
                    remedy="Put the closed axis that runs around the pole right after it.",
                )

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return len(self.ends)

    @property
    def closed_axes(self) -> tuple[int, ...]:
        """Indices of the closed axes."""
        return tuple(i for i, ends in enumerate(self.ends) if ends == CLOSED)

    @property
    def name(self) -> str:
        """Common name if it has one ("cup"), else the ends ("open x open x closed")."""
        return _NAMES.get(self.ends, " x ".join(_AXIS_NAMES[e] for e in self.ends))

    def __str__(self) -> str:
        return self.name

    @staticmethod
    def parse(text: str) -> Topology:
        """Read a topology from its name or its ends.

        Parameters
        ----------
        text : str
            "cup", "closed curve", ..., or ends joined by " x " such as "pole-open x closed".
            A note in parentheses is ignored.

        Raises
        ------
        TopologyError
            If the text names no topology.
        """
        word = text.split("(")[0].strip().lower().replace("_", " ")
        if word == MESH:
            raise TopologyError(
                "'mesh' says how a surface is read, by the springs along its edges, and not what "
                "surface it is.",
                remedy="Leave the topology out where a recording is described, and ask for "
                "topology=mesh where a signature, a trade-off, a template or a model is made.",
            )
        for ends, name in _NAMES.items():
            if word == name:
                return Topology(ends)
        axes = {name: ends for ends, name in _AXIS_NAMES.items()}
        try:
            return Topology(tuple(axes[part.strip()] for part in word.split(" x ")))
        except KeyError:
            raise TopologyError(
                f"{text[:80]!r} names no topology.",
                remedy=f"Use one of {', '.join(sorted(_NAMES.values()))}, or the ends of each "
                "axis joined by ' x ', each open, closed, pole-open or pole-pole.",
            ) from None


OPEN_CURVE: Final = Topology((OPEN,))
CLOSED_CURVE: Final = Topology((CLOSED,))
PLANE: Final = Topology((OPEN, OPEN))
CYLINDER: Final = Topology((OPEN, CLOSED))
TORUS: Final = Topology((CLOSED, CLOSED))
CUP: Final = Topology((POLE_OPEN, CLOSED))
SPHERE: Final = Topology((POLE_POLE, CLOSED))

_NAMES: Final[dict[tuple[Ends, ...], str]] = {
    OPEN_CURVE.ends: "open curve",
    CLOSED_CURVE.ends: "closed curve",
    PLANE.ends: "plane",
    CYLINDER.ends: "cylinder",
    TORUS.ends: "torus",
    CUP.ends: "cup",
    SPHERE.ends: "sphere",
}


# A wave has mean square 1/2 along each axis, or each wave vector of closed axes together.
_SCALES: Final = np.sqrt([1.0, 2.0, 4.0, 8.0])


class ModeLabel(NamedTuple):
    """Name of one mode.

    Parameters
    ----------
    wavenumbers : tuple of int
        One for each axis: counted from 0 on open and pole axes, the (signed) number of
        periods on closed ones. For a spring mode its place in the order of frequency.
    part : "cos", "sin" or "spring"
        One of the two shapes of a wave vector; "cos" where there is only one.
    """

    wavenumbers: tuple[int, ...]
    part: Literal["cos", "sin", "spring"]

    def __str__(self) -> str:
        numbers = ", ".join(map(str, self.wavenumbers))
        return f"(spring {numbers})" if self.part == "spring" else f"({numbers}, {self.part})"


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
