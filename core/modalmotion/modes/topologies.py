"""Topologies, the ends of each axis of a surface, and the names of their modes."""

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np

from modalmotion.errors import LimitError, ParameterError, ShapeError, TopologyError
from modalmotion.representation import Bools, Floats, Ints, shown, with_article


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
    def parse(text: str) -> "Topology":
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


def scales_of(n_waves: Ints) -> Floats:
    """Factors that give shapes with so many waves mean square 1, (modes,) float64."""
    # A wave has mean square 1/2 along each axis, or each wave vector of closed axes together.
    return np.asarray(np.sqrt(2.0**n_waves))


def odd_at_pole(topology: Topology, wavenumbers: Ints) -> Bools:
    """Where a pole axis carries the sine family: the closed axis after it has odd p'."""
    odd = np.zeros(wavenumbers.shape, dtype=np.bool_)
    for axis, ends in enumerate(topology.ends):
        if ends not in (OPEN, CLOSED):
            odd[:, axis] = wavenumbers[:, axis + 1] % 2 == 1
    return odd


def half_periods(topology: Topology, wavenumbers: Ints) -> Ints:
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


# 8 N parts of a turn, and twice as many half periods, stay below 2^60.
_MOST_NODES_ALONG_AXIS: Final = 2**56


def require_shape(topology: Topology, shape: tuple[int, ...]) -> None:
    """Refuse a lattice shape without a closed form on the topology.

    Raises
    ------
    ShapeError
        If the number of axes differs, an axis has no node, or the closed axis around a pole
        has an odd number of nodes.
    LimitError
        If an axis has more nodes than phases of 64 bits can resolve.
    """
    if len(shape) != topology.n_axes or min(shape, default=0) < 1:
        raise ShapeError(
            f"A {topology} lattice has {topology.n_axes} axes of at least one node, "
            f"not the shape {tuple(shape)}.",
            remedy="Give the number of nodes along each axis.",
        )
    if max(shape) > _MOST_NODES_ALONG_AXIS:
        raise LimitError(
            f"An axis of {max(shape)} nodes is longer than 2^56.",
            remedy="Use fewer nodes.",
            limit="nodes along an axis",
            details={"nodes": max(shape), "most": _MOST_NODES_ALONG_AXIS},
        )
    for axis, ends in enumerate(topology.ends):
        if End.POLE in ends and shape[axis + 1] % 2 == 1:
            raise ShapeError(
                f"Axis {axis + 1} runs around a pole and has {shape[axis + 1]} nodes: with an "
                "odd number no node is opposite another, and there is no closed form.",
                remedy="Use an even number of nodes, or the cylinder.",
                details={"axis": axis + 1, "nodes": shape[axis + 1]},
            )


def lattice_coordinates(topology: Topology, shape: tuple[int, ...]) -> Floats:
    """Natural coordinates of every node of a lattice, (nodes, axes) float64.

    From 0 to 1 along each axis: (2 n - 1) / 2 N on an axis with ends, n / N on a closed one.
    """
    axes = [
        np.arange(1, n + 1) / n if ends == CLOSED else np.arange(1, 2 * n, 2) / (2 * n)
        for ends, n in zip(topology.ends, shape, strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return grid.reshape(-1, topology.n_axes)


_SPRING: Final = re.compile(r"\s*\(?\s*spring[\s,]*([0-9]{1,9})\s*\)?\s*")
_LABEL: Final = re.compile(r"\s*\(?\s*((?:-?[0-9]{1,9}\s*,\s*){1,3})(cos|sin)\s*\)?\s*")


def parse_label(text: str) -> ModeLabel:
    """Read a label such as "1,1,cos" or "spring 3", or as it is printed: "(1, 1, cos)".

    Raises
    ------
    ParameterError
        If the text is not a label.
    """
    if rank := _SPRING.fullmatch(text):
        return ModeLabel((int(rank[1]),), "spring")
    parts = _LABEL.fullmatch(text)
    if parts is None:
        raise ParameterError(
            f"{text[:40]!r} is not the label of a mode.",
            remedy="Write one wavenumber for each axis, then cos or sin: 1,1,cos; or, on a mesh "
            "without natural coordinates, spring and a rank: spring 3.",
        )
    wavenumbers = tuple(int(p) for p in parts[1].split(",") if p.strip())
    return ModeLabel(wavenumbers, "sin" if parts[2] == "sin" else "cos")


def require_mode(topology: Topology, label: ModeLabel) -> None:
    """Refuse a label that names no mode of a topology.

    Raises
    ------
    ParameterError
    """
    p, closed, name = label.wavenumbers, topology.closed_axes, with_article(topology.name)
    # One of p and -p names the wave: the first wavenumber around a closed axis is not negative.
    first = next((p[axis] for axis in closed if axis < len(p) and p[axis]), 0)
    fault, remedy = "", ""
    if label.part == "spring":
        fault = f"names a spring mode, but {name} has modes in closed form"
        remedy = "Write one wavenumber for each axis, then cos or sin: 1,1,cos."
    elif len(p) != topology.n_axes:
        fault = f"has {len(p)} wavenumbers; {name} has {topology.n_axes} axes"
        remedy = "Give one wavenumber for each axis."
    elif any(k < 0 for axis, k in enumerate(p) if axis not in closed):
        fault = "counts backwards along an axis that is not closed"
        remedy = "Use wavenumbers from 0 on."
    elif first == 0 and label.part == "sin":
        fault = (
            f"is not a mode of {name}: the sine of a wave without any period around a closed axis "
            "is zero everywhere"
        )
        remedy = "Use its cosine."
    elif first < 0:
        meant = tuple(-k if axis in closed else k for axis, k in enumerate(p))
        fault = "runs against the sense in which waves are counted"
        remedy = f"Use {ModeLabel(meant, label.part)}; a sine changes its sign."
    if fault:
        raise ParameterError(f"{label} {fault}.", remedy=remedy, details={"label": str(label)})


class Surface(Protocol):
    """Properties of a surface that modes need; a template has them."""

    @property
    def coordinates(self) -> Floats:
        """Natural coordinates, (vertices, axes) float64: see `ModeSet.shapes_at`."""

    @property
    def lengths(self) -> tuple[float, ...]:
        """Length along each axis, length unit."""

    @property
    def vertices(self) -> Floats:
        """Positions, (vertices, 3) float64, length unit."""

    @property
    def faces(self) -> Ints:
        """Triangles, (faces, 3) int64."""

    @property
    def representatives(self) -> Ints:
        """Vertex that represents each in the triangles, (vertices,) int64."""
