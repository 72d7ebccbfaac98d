"""Lattices of masses and springs: products of chains, whose modes are known in closed form.

Equation numbers are those of Nastar, INRIA research report, 1994.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from modalmotion.arguments.checking import real, whole_numbers
from modalmotion.errors import LimitError, ParameterError, ShapeError, TopologyError
from modalmotion.modes.mode_set import ModeSet, all_modes, lowest_modes, whole_count
from modalmotion.modes.topology import (
    CLOSED,
    ModeLabel,
    Topology,
    require_mode,
    require_shape,
    scales_of,
)
from modalmotion.modes.trigonometry import cosines, sin_pi
from modalmotion.representation import Floats, Ints, shown


@shown()
@dataclass(frozen=True)
class Lattice:
    """A lattice of equal masses joined by springs to their neighbours along each axis.

    Nodes are numbered row by row: node = row * N' + column. Their displacements U move by
    (1) M U'' + C U' + K U = F, one direction at a time: M is the mass of a node, K the stiffness
    matrix of the springs. Its modes (6) K Phi = M Phi Omega^2 are `shapes`, Phi, and
    `angular_frequencies`, the diagonal of Omega, both in closed form: neither K nor any other
    matrix of the size of the lattice is ever built.

    Parameters
    ----------
    topology : Topology
    shape : tuple of int
        Nodes along each axis.
    stiffness : float or tuple of float, force per length
        K, one for all axes or one for each.
    mass : float
        M of one node.

    Raises
    ------
    ShapeError
        If the shape does not fit the topology.
    ParameterError
        If a stiffness or the mass is not positive and finite.
    """

    topology: Topology
    shape: tuple[int, ...]
    stiffness: float | tuple[float, ...] = 1.0
    mass: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", whole_numbers("shape", self.shape))
        require_shape(self.topology, self.shape)
        if isinstance(self.stiffness, tuple):
            for K in self.stiffness:
                real("A stiffness", K)
        else:
            real("stiffness, one number or a tuple of one for each axis,", self.stiffness)
        real("mass", self.mass)
        for name, value in (("stiffness K", self.stiffnesses), ("mass M", (self.mass,))):
            if not all(math.isfinite(v) and v > 0 for v in value):
                raise ParameterError(
                    f"The {name} is {value}, but only positive finite values make a lattice "
                    "that oscillates.",
                    remedy="Use values above zero.",
                )
        if len(self.stiffnesses) != self.topology.n_axes:
            raise ParameterError(
                f"{len(self.stiffnesses)} stiffnesses for {self.topology.n_axes} axes.",
                remedy="Give one stiffness, or one for each axis.",
            )
        # No mode is faster than all springs stretched together.
        ratios, exponent = self.squared_speeds
        with np.errstate(over="ignore"):
            fastest = np.ldexp(np.sqrt(4.0 * ratios.sum()), exponent // 2)
        if not np.isfinite(fastest):
            raise ParameterError(
                f"Stiffnesses {self.stiffnesses} with the mass {self.mass} make frequencies beyond "
                "the largest number.",
                remedy="State them in another unit of time, which changes the stiffness alone.",
            )

    @property
    def stiffnesses(self) -> tuple[float, ...]:
        """K along each axis."""
        if isinstance(self.stiffness, tuple):
            return self.stiffness
        return (float(self.stiffness),) * self.topology.n_axes

    @cached_property
    def squared_speeds(self) -> tuple[Floats, int]:
        """K / M of each axis times 2^-exponent, and the exponent, which is even.

        Neither overflows where the frequencies, their roots, do not; powers of two are exact.
        """
        K, of_K = np.frexp(np.array(self.stiffnesses, dtype=np.float64))
        M, of_M = np.frexp(float(self.mass))
        exponent = 2 * (int(of_K.max() - of_M) // 2)
        return np.ldexp(K / M, of_K - of_M - exponent), exponent

    @property
    def n_nodes(self) -> int:
        """Number of nodes, which is the number of modes."""
        return math.prod(self.shape)

    def lowest_modes(self, n_modes: int) -> ModeSet:
        """First modes in the fixed order, taken literally."""
        return lowest_modes(self.topology, n_modes, self.shape)

    def whole_modes(self, n_modes: int) -> ModeSet:
        """First modes in the fixed order, rounded up so that no pair is split."""
        return self.lowest_modes(whole_count(self.topology, n_modes, self.shape))

    def all_modes(self) -> ModeSet:
        """Every mode, in the fixed order."""
        return self._all_modes

    @cached_property
    def _all_modes(self) -> ModeSet:
        return all_modes(self.topology, self.shape)

    def angular_frequencies(self, modes: ModeSet) -> Floats:
        """Angular frequency of each mode, the dispersion relation (7) summed over the axes.

        Returns
        -------
        (modes,) float64, rad per time unit

        Raises
        ------
        TopologyError, ParameterError
            As `shapes`.
        """
        self._require(modes)
        omega_squared = np.zeros(len(modes))
        ratios, exponent = self.squared_speeds
        for axis, (ends, n, ratio) in enumerate(
            zip(self.topology.ends, self.shape, ratios.tolist(), strict=True)
        ):
            # (7) w^2 = (4 K / M) sin^2(k a / 2), and k a / 2 = p pi / N closed, h pi / 4N else.
            # Never 2 - 2 cos(k a): at N = 1e8 that is wrong by a tenth.
            h = modes.half_periods[:, axis]
            half_angle = sin_pi(h, n if ends == CLOSED else 4 * n)
            omega_squared += (4.0 * ratio) * half_angle**2
        frequencies: Floats = np.ldexp(np.sqrt(omega_squared), exponent // 2)
        return frequencies

    def shapes(self, modes: ModeSet, nodes: Ints | list[int] | None = None) -> Floats:
        """Evaluate mode shapes at the nodes, the Phi of (6) K Phi = M Phi Omega^2.

        Parameters
        ----------
        modes : ModeSet
        nodes : (nodes,) int64, optional
            These nodes only, in this order. Nothing is built for the others: the lattice may
            be of any size.

        Returns
        -------
        (nodes, modes) float64
            Phi, each column with mean square 1: Phi'Phi is the number of nodes times the
            identity. One mode after the other in memory.

        Raises
        ------
        TopologyError
            If the modes are of another topology.
        ParameterError
            If a mode is beyond the lattice's Nyquist wavenumber.
        ShapeError
            If the lattice has no such node.
        """
        self._require(modes)
        places = map(np.arange, self.shape) if nodes is None else places_along(self.shape, nodes)
        closed, none = self.topology.closed_axes, np.zeros(len(modes), dtype=np.bool_)
        # Each axis has a dimension of its own; listed nodes share one.
        n_dimensions = self.topology.n_axes if nodes is None else 1
        by_mode = self.scales(modes).reshape(-1, *[1] * n_dimensions)
        waves = np.ones(1, dtype=np.complex128)
        for axis, (n, place) in enumerate(zip(self.shape, places, strict=True)):
            h, size = modes.half_periods[:, axis], [len(modes), *[1] * n_dimensions]
            size[1 + axis % n_dimensions] = len(place)
            if axis not in closed:
                # cos or sin(h pi (2n - 1) / 4N), n = 1..N
                factor = cosines(h, 2 * place + 1, 8 * n, modes.is_odd_at_pole[:, axis])
            elif len(closed) == 1:
                # cos or sin(2 pi p n / N)
                factor = cosines(h, place + 1, n, modes.is_sine)
            else:
                # cos(a + b) + i sin(a + b) = (cos a + i sin a) (cos b + i sin b)
                real, imaginary = (cosines(h, place + 1, n, is_sine) for is_sine in (none, ~none))
                waves = waves * (real + 1j * imaginary).reshape(size)
                continue
            by_mode = by_mode * factor.reshape(size)
        if len(closed) > 1:
            is_sine = modes.is_sine.reshape(-1, *[1] * n_dimensions)
            by_mode = by_mode * np.where(is_sine, waves.imag, waves.real)
        return by_mode.reshape(len(modes), -1).T

    def scales(self, modes: ModeSet) -> Floats:
        """Factors that give every shape mean square 1 over the nodes, (modes,) float64.

        As on a continuum, but for shapes that alternate from node to node: these are +1 and
        -1, with mean square 1 already.
        """
        n_waves = modes.n_waves
        closed = list(self.topology.closed_axes)
        if closed:
            k = modes.wavenumbers[:, closed]
            n = np.array([self.shape[axis] for axis in closed])
            n_waves = n_waves - ((2 * k % n == 0).all(axis=1) & (k != 0).any(axis=1))
        for axis, (ends, nodes) in enumerate(zip(self.topology.ends, self.shape, strict=True)):
            if ends != CLOSED:
                n_waves = n_waves - (modes.half_periods[:, axis] == 2 * nodes)
        return scales_of(n_waves)

    def _require(self, modes: ModeSet) -> None:
        if modes.topology is not self.topology and modes.topology != self.topology:
            raise TopologyError(
                f"Modes of a {modes.topology} have no place on a {self.topology} lattice.",
                remedy="Choose the modes from the lattice itself, with `lowest_modes`.",
            )
        require_within_zone(modes, self.shape)


def places_along(shape: tuple[int, ...], nodes: Ints | list[int]) -> list[Ints]:
    """Find the place of nodes along each axis.

    Parameters
    ----------
    shape : tuple of int
    nodes : (nodes,) int64
        Numbered row by row.

    Returns
    -------
    list of (nodes,) int64

    Raises
    ------
    ShapeError
        If they are not a list of integers, or one of them is not a node.
    LimitError
        If 64 bits do not number all nodes.
    """
    n_nodes = math.prod(shape)
    if n_nodes >= 2**63:
        raise LimitError(
            f"A lattice of {shape} nodes has more than 64 bits number.",
            remedy="Evaluate the axes one by one, as curves.",
            limit="nodes",
        )
    numbers = np.asarray(nodes)
    if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
        raise ShapeError(
            f"Nodes are a list of integers, not {numbers.dtype} of the shape {numbers.shape}.",
            remedy="Number them row by row: node = row * N' + column.",
        )
    bad = np.flatnonzero((numbers < 0) | (numbers >= n_nodes))
    if bad.size:
        raise ShapeError(
            f"There is no node {numbers[bad[0]]} on a lattice of {n_nodes}.",
            remedy=f"Number nodes from 0 to {n_nodes - 1}.",
            vertex=int(numbers[bad[0]]),
        )
    along = np.unravel_index(numbers.astype(np.int64), shape)
    return [place.astype(np.int64) for place in along]


def require_within_zone(modes: ModeSet, shape: tuple[int, ...]) -> None:
    """Refuse modes beyond the lattice's Nyquist wavenumber: they would alias into low ones.

    Raises
    ------
    ParameterError
        Naming the first label at fault and the largest wavenumber the axis resolves, or the
        sine of a wave vector that is its own opposite.
    """
    has_zeros = False
    for axis, (ends, n) in enumerate(zip(modes.topology.ends, shape, strict=True)):
        least, most = (-((n - 1) // 2), n // 2) if ends == CLOSED else (0, n - 1)
        lowest, highest = modes.extents[axis]
        if lowest < least or highest > most:
            p = modes.wavenumbers[:, axis]
            beyond = np.flatnonzero((p < least) | (p > most))
            raise ParameterError(
                f"Mode {modes.labels[beyond[0]]} is beyond what {n} nodes along axis {axis} "
                f"resolve ({least} to {most}) and would alias into a lower mode.",
                remedy="Ask for lower wavenumbers, or use more nodes.",
                details={"axis": axis, "least": least, "most": most},
            )
        has_zeros |= ends == CLOSED and (2 * highest == n or lowest == 0)
    if has_zeros:
        _require_nonzero(modes, shape)


def _require_nonzero(modes: ModeSet, shape: tuple[int, ...]) -> None:
    """Refuse sines that are zero at every node."""
    closed = list(modes.topology.closed_axes)
    n = np.array([shape[axis] for axis in closed], dtype=np.int64)
    zero = np.flatnonzero(modes.is_sine & (2 * modes.wavenumbers[:, closed] % n == 0).all(axis=1))
    if zero.size:
        raise ParameterError(
            f"Mode {modes.labels[zero[0]]} is zero at every node of a lattice of {shape} nodes.",
            remedy="Ask for its cosine alone.",
        )


def modes_named(
    topology: Topology, labels: list[ModeLabel], shape: tuple[int, ...] | None = None
) -> ModeSet:
    """Modes with these labels, each checked to be a mode of the topology.

    Parameters
    ----------
    topology : Topology
    labels : list of ModeLabel
    shape : tuple of int, optional
        Nodes along each axis of a lattice, which has no modes beyond its Nyquist wavenumber.

    Raises
    ------
    ParameterError
        Naming the first label that no mode of the topology has, and the intended one if
        there is one.
    """
    for label in labels:
        require_mode(topology, label)
    modes = ModeSet.of(topology, labels)
    if shape is not None:
        require_shape(topology, shape)
        require_within_zone(modes, shape)
    return modes
