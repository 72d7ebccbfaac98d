"""Modes of one topology, in closed form: order, shapes and frequencies on a continuum.

The limit of fine lattices: the shapes solve (6) between the nodes too, and the frequencies are
those of (7) while waves are long. Equation numbers are those of Nastar (1994).

The order is by physical wavenumber on a reference surface whose axis is 0.55 of its
circumference, computed in integers. It depends on the topology alone, never on the number of
nodes or on the eigenvalues of the surface at hand, so a label keeps its place everywhere.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np

from modalmotion.arguments.checking import FrozenArrays, whole
from modalmotion.errors import LimitError, ModeCountError
from modalmotion.modes.topologies import (
    CLOSED,
    End,
    ModeLabel,
    Surface,
    Topology,
    half_periods,
    odd_at_pole,
    require_shape,
    scales_of,
)
from modalmotion.representation import Array, Bools, Floats, Ints, shown


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
    wavenumbers: Ints
    is_sine: Bools

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
    def half_periods(self) -> Ints:
        """Half periods of each shape along each axis, twice counted on non-closed axes.

        Returns
        -------
        (modes, axes) int64
            On a closed axis the signed number of whole periods p; on any other axis the
            integer h of cos(h pi s / 2) or sin(h pi s / 2).
        """
        return half_periods(self.topology, self.wavenumbers)

    @cached_property
    def is_odd_at_pole(self) -> Bools:
        """Whether the factor along each axis is the sine that vanishes at a pole.

        Returns
        -------
        (modes, axes) bool
        """
        return odd_at_pole(self.topology, self.wavenumbers)

    @cached_property
    def n_waves(self) -> Ints:
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

    @property
    def connectivity_id(self) -> str:
        """Empty: these modes belong to every mesh of the topology."""
        return ""

    @property
    def names(self) -> "ModeSet":
        """These modes themselves: nothing had to be solved for."""
        return self

    @property
    def arrays(self) -> dict[str, Array]:
        """Datasets of the modes in files."""
        return {"wavenumbers": self.wavenumbers, "is_sine": self.is_sine}

    def take(self, indices: Ints | list[int] | slice) -> "ModeSet":
        """Modes at these indices, in this order."""
        return ModeSet(self.topology, self.wavenumbers[indices], self.is_sine[indices])

    @staticmethod
    def of(topology: Topology, labels: tuple[ModeLabel, ...] | list[ModeLabel]) -> "ModeSet":
        """Modes with these labels, in this order."""
        wavenumbers = np.array([label.wavenumbers for label in labels], dtype=np.int64)
        return ModeSet(
            topology,
            wavenumbers.reshape(len(labels), topology.n_axes),
            np.array([label.part == "sin" for label in labels], dtype=np.bool_),
        )

    def shapes_at(self, coordinates: Floats) -> Floats:
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

    def shapes_on(self, surface: Surface) -> Floats:
        """Evaluate the shapes at the vertices of a surface, (vertices, modes) float64."""
        return self.shapes_at(surface.coordinates)

    def wavenumbers_on(self, lengths: tuple[float, ...]) -> Floats:
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

    def frequencies_on(self, surface: Surface, wave_speed: float) -> Floats:
        """Angular frequencies w = c k, (modes,) float64, rad per s, in the limit of long waves."""
        finite = tuple(length if length > 0 else np.inf for length in surface.lengths)
        return np.asarray(wave_speed * self.wavenumbers_on(finite))

    def length_of(
        self,
        lengths: tuple[float, ...],
        angular_frequencies: Floats,  # noqa: ARG002 (springs need them)
        wave_speed: float,  # noqa: ARG002
    ) -> float:
        """Geometric mean of the lengths along the coordinates; 1 if one of them is zero."""
        if len(lengths) and min(lengths) > 0:
            return math.exp(sum(map(math.log, lengths)) / len(lengths))
        return 1.0


def _each_once(*columns: Array) -> tuple[Array, Ints]:
    """Give different rows of columns once, a column each, and which of them each row is."""
    rows, own = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
    return rows.T, own.ravel()


# Squared reciprocal reference lengths times 121, as integers: axis 11/20, circumference 1,
# and 1/10 for a third axis (the thickness of a wall).
_INVERSE_SQUARED_LENGTHS: Final = (400, 121, 12_100)


_LARGEST_COUNT: Final = 10_000_000


# The order is a fixed table: its beginnings are worked out once.
_KEPT_COUNT: Final = 1024


def lowest_modes(topology: Topology, n_modes: int, shape: tuple[int, ...] | None = None) -> ModeSet:
    """First modes in the fixed order, chosen without building all of them.

    Parameters
    ----------
    topology : Topology
    n_modes : int
        How many. Taken literally: see `whole_count` for counts that split no pair.
    shape : tuple of int, optional
        Nodes along each axis of a lattice, which has no modes beyond its Nyquist
        wavenumber; without it the surface is a continuum and has any number of modes.

    Raises
    ------
    ModeCountError
        If `n_modes` is below 1, above ten million, or above the number of modes of the
        lattice.
    """
    n_modes = whole("n_modes", n_modes)
    n_total = _LARGEST_COUNT if shape is None else _n_modes_of(topology, shape)
    most = min(n_total, _LARGEST_COUNT)
    if not 1 <= n_modes <= most:
        raise ModeCountError(
            f"{n_modes} modes were requested; a {topology} "
            f"{'' if shape is None else f'of {shape} nodes '}has 1 to {most}.",
            remedy=f"Ask for 1 to {most} modes.",
            details={"modes": n_modes, "most": most},
        )
    lowest = _lowest if n_modes <= _KEPT_COUNT else _lowest.__wrapped__
    return lowest(topology, n_modes, shape)


def whole_count(topology: Topology, n_modes: int, shape: tuple[int, ...] | None = None) -> int:
    """Smallest count from `n_modes` on that splits no cosine-sine pair.

    A split pair would make a signature depend on where the angle starts.
    """
    modes = lowest_modes(topology, n_modes, shape)
    if modes.is_sine[-1] or len(modes) == (shape is not None and _n_modes_of(topology, shape)):
        return n_modes
    more = lowest_modes(topology, n_modes + 1, shape)
    return n_modes + int(more.is_sine[-1])


def all_modes(topology: Topology, shape: tuple[int, ...]) -> ModeSet:
    """Every mode of a lattice, in the fixed order: as many as it has nodes."""
    return lowest_modes(topology, _n_modes_of(topology, shape), shape)


def squared_keys(topology: Topology, wavenumbers: Ints) -> Ints:
    """Squared wavenumbers on the reference surface, times 484 / pi^2: integers, no ties lost.

    Raises
    ------
    LimitError
        If 64 bits do not contain them.
    """
    h = half_periods(topology, wavenumbers)
    key = np.zeros(len(h), dtype=np.int64)
    most = 0
    for axis, weight in enumerate(_weights(topology)):
        most += weight * int(np.abs(h[:, axis]).max(initial=0)) ** 2
        key += weight * h[:, axis] ** 2
    if most >= 2**63:
        raise LimitError(
            "The squared wavenumbers of these modes exceed integers of 64 bits.",
            remedy="Ask for lower modes.",
            limit="squared wavenumber",
        )
    return key


def _weights(topology: Topology) -> list[int]:
    """Weigh a squared half period (closed: period) along each axis in the key."""
    # k = pi h / 2L on non-closed axes, 2 pi p / L on closed ones.
    return [
        w * (16 if ends == CLOSED else 1)
        for w, ends in zip(_INVERSE_SQUARED_LENGTHS, topology.ends, strict=False)
    ]


def _n_modes_of(topology: Topology, shape: tuple[int, ...]) -> int:
    require_shape(topology, shape)
    return math.prod(map(int, shape))


@lru_cache(maxsize=64)
def _lowest(topology: Topology, n_modes: int, shape: tuple[int, ...] | None) -> ModeSet:
    bound = 4.0 * max(_INVERSE_SQUARED_LENGTHS)
    if shape is not None and n_modes == _n_modes_of(topology, shape):
        bound = sum(w * (2.0 * n) ** 2 for w, n in zip(_weights(topology), shape, strict=True))
    while True:
        modes, keys = _modes_within(topology, bound, shape)
        # A whole level is needed so that ties are broken among all of its members.
        if len(modes) >= n_modes:
            return modes.take(np.lexsort(keys)[:n_modes])
        bound *= 2.0 if len(modes) > 1000 else 4.0


def _modes_within(
    topology: Topology, bound: float, shape: tuple[int, ...] | None
) -> tuple[ModeSet, tuple[Ints | Bools, ...]]:
    """All modes whose squared key is at most `bound`, with the keys that sort them."""
    axes = []
    for axis, (ends, weight) in enumerate(zip(topology.ends, _weights(topology), strict=True)):
        # h = 2 p at least on non-closed axes
        most = int((bound / weight) ** 0.5 / (1 if ends == CLOSED else 2))
        low, high = (most, most) if ends == CLOSED else (0, most)
        if shape is not None:
            n = shape[axis]
            low, high = min(low, (n - 1) // 2), min(high, n // 2 if ends == CLOSED else n - 1)
        axes.append(np.arange(-low, high + 1, dtype=np.int64))
    p = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, topology.n_axes)
    p = p[squared_keys(topology, p) <= bound]

    # Of a wave vector and its opposite, keep the one whose first entry that differs from
    # its own opposite is positive. Where none differs the sine is zero and not a mode.
    sign = np.zeros(len(p), dtype=np.int8)
    for axis in topology.closed_axes:
        entry = np.sign(p[:, axis]).astype(np.int8)
        if shape is not None:
            entry[2 * p[:, axis] == shape[axis]] = 0
        sign = np.where(sign == 0, entry, sign)
    p, is_pair = p[sign >= 0], sign[sign >= 0] > 0

    wavenumbers = np.concatenate([p, p[is_pair]])
    is_sine = np.concatenate([np.zeros(len(p), bool), np.ones(int(is_pair.sum()), bool)])
    key = squared_keys(topology, wavenumbers)
    ties = [column for q in wavenumbers.T[::-1] for column in (q < 0, np.abs(q))]
    return ModeSet(topology, wavenumbers, is_sine), (is_sine, *ties, key)
