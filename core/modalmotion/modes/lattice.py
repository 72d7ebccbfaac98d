"""Lattices of masses and springs: products of chains, whose modes are known in closed form.

Equation numbers are those of Nastar, INRIA research report, 1994.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.checking import real, whole_numbers
from modalmotion.errors import ParameterError, TopologyError
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.order import (
    all_modes,
    lowest_modes,
    require_shape,
    require_within_zone,
    whole_count,
)
from modalmotion.modes.separable import Factors, expand, functions_at, functions_on, places_along
from modalmotion.modes.topology import CLOSED, Topology, scales_of
from modalmotion.modes.trigonometry import sin_pi
from modalmotion.representation import shown


@shown("sines", "mode")
class Places(NamedTuple):
    """Where one term of each of some modes is in the spectrum.

    Parameters
    ----------
    sines : tuple of bool
        For each closed axis whether the term is a multiple of its sine.
    mode : (terms,) int32
        No mode twice.
    place : (terms,) int32
        Row by row over the axes' wavenumbers; no place twice.
    sign : (terms,) int8
    halvings : (terms,) int8
        Number of axes along which the term has mean square 1/2.
    """

    sines: tuple[bool, ...]
    mode: NDArray[np.int32]
    place: NDArray[np.int32]
    sign: NDArray[np.int8]
    halvings: NDArray[np.int8]


def spectrum_shape(topology: Topology, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Wavenumbers along each axis of the spectrum: N // 2 + 1 on closed axes, N on others."""
    return tuple(
        n // 2 + 1 if ends == CLOSED else n for ends, n in zip(topology.ends, shape, strict=True)
    )


def places(modes: ModeSet, shape: tuple[int, ...]) -> tuple[Places, ...]:
    """Find the terms of modes in the spectrum of a lattice.

    Parameters
    ----------
    modes : ModeSet
        Each at most once.
    shape : tuple of int
        Nodes along each axis.
    """
    places = []
    topology, closed = modes.topology, modes.topology.closed_axes
    for term in expand(topology, modes.half_periods, modes.is_odd_at_pole, modes.is_sine):
        halvings = np.zeros(len(term.mode), dtype=np.int8)
        place = np.zeros(len(term.mode), dtype=np.int64)
        for axis, n in enumerate(spectrum_shape(topology, shape)):
            p = np.abs(modes.wavenumbers[term.mode, axis])
            place = place * n + p
            period = shape[axis] if topology.ends[axis] == CLOSED else 4 * shape[axis]
            # A constant and a wave that alternates from node to node have mean square 1.
            h = modes.half_periods[term.mode, axis]
            halvings += 2 * h % period != 0
        # (p, p') and (p, -p') have the same products: apart.
        negative = modes.wavenumbers[term.mode][:, list(closed)] < 0
        for signs in product((False, True), repeat=len(closed)):
            part = np.flatnonzero((negative == signs).all(axis=1))
            if part.size:
                places.append(
                    Places(
                        term.sines,
                        term.mode[part].astype(np.int32),
                        place[part].astype(np.int32),
                        term.sign[part],
                        halvings[part],
                    )
                )
    return tuple(places)


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
    def squared_speeds(self) -> tuple[NDArray[np.float64], int]:
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

    @cached_property
    def places(self) -> tuple[Places, ...]:
        """Where the terms of every mode are in the spectrum of the fast transforms."""
        return places(self._all_modes, self.shape)

    @cached_property
    def natural_coordinates(self) -> NDArray[np.float64]:
        """Natural coordinates of every node.

        Returns
        -------
        (nodes, axes) float64
            (2n - 1) / 2N on open and pole axes, n / N on closed ones, n = 1..N.
        """
        axes = [
            np.arange(1, n + 1) / n if ends == CLOSED else np.arange(1, 2 * n, 2) / (2 * n)
            for ends, n in zip(self.topology.ends, self.shape, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return grid.reshape(self.n_nodes, self.topology.n_axes)

    def angular_frequencies(self, modes: ModeSet) -> NDArray[np.float64]:
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
        frequencies: NDArray[np.float64] = np.ldexp(np.sqrt(omega_squared), exponent // 2)
        return frequencies

    def factors(self, modes: ModeSet) -> Factors:
        """Evaluate mode shapes as sums of products of one function per axis.

        All of every shape is in them, at the cost of N + N' numbers instead of N N'.

        Raises
        ------
        TopologyError, ParameterError
            As `shapes`.
        """
        coefficients = self._coefficients(modes)
        return Factors(functions_on(modes.separable, self.shape), modes.separable, coefficients)

    def shapes(
        self,
        modes: ModeSet,
        nodes: NDArray[np.int64] | list[int] | None = None,
        *,
        out: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
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
            If the lattice has no such node, or `out` is not such an array.
        """
        if nodes is None:
            return self.factors(modes).shapes(out)
        coefficients, separable = self._coefficients(modes), modes.separable
        functions = tuple(
            functions_at(separable, axis, n, along)
            for axis, (n, along) in enumerate(
                zip(self.shape, places_along(self.shape, nodes), strict=True)
            )
        )
        return Factors(functions, separable, coefficients).shapes_along()

    def scales(self, modes: ModeSet) -> NDArray[np.float64]:
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

    def _coefficients(self, modes: ModeSet) -> NDArray[np.float64]:
        """Sign of each term times the scale of its mode, (terms,) float64."""
        self._require(modes)
        for ends, h, n in zip(self.topology.ends, modes.separable.largest, self.shape, strict=True):
            # Where shapes alternate from node to node.
            if 2 * h == (n if ends == CLOSED else 4 * n):
                return modes.separable.signs * self.scales(modes)[modes.separable.mode]
        return modes.coefficients
