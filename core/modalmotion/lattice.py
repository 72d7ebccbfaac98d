"""Lattices of masses and springs: products of chains, whose modes are known in closed form.

Equation numbers are those of Nastar, INRIA research report, 1994.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.modes.label import ModeSet
from modalmotion.modes.order import (
    all_modes,
    lowest_modes,
    require_shape,
    require_within_zone,
    whole_count,
)
from modalmotion.modes.shapes import scales
from modalmotion.modes.trigonometry import cos_pi, sin_pi
from modalmotion.topology import CLOSED, Topology


@dataclass(frozen=True)
class Lattice:
    """A lattice of equal masses joined by springs to their neighbours along each axis.

    Nodes are numbered row by row: node = row * N' + column.

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
        object.__setattr__(self, "shape", tuple(int(n) for n in self.shape))
        require_shape(self.topology, self.shape)
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

    @property
    def stiffnesses(self) -> tuple[float, ...]:
        """K along each axis."""
        if isinstance(self.stiffness, tuple):
            return self.stiffness
        return (float(self.stiffness),) * self.topology.n_axes

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
        return all_modes(self.topology, self.shape)

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
        """Angular frequency of each mode, eq. 7 summed over the axes.

        Returns
        -------
        (modes,) float64, rad per time unit

        Raises
        ------
        ParameterError
            If a mode lies beyond the lattice's Nyquist wavenumber.
        """
        require_within_zone(modes, self.shape)
        omega_squared = np.zeros(len(modes))
        for axis, (ends, n, K) in enumerate(
            zip(self.topology.ends, self.shape, self.stiffnesses, strict=True)
        ):
            # w^2 = (4 K / M) sin^2(k a / 2), and k a / 2 = p pi / N closed, h pi / 4N else.
            # Never 2 - 2 cos(k a): at N = 1e8 that is wrong by a tenth.
            h = modes.half_periods[:, axis]
            half_angle = sin_pi(h, n if ends == CLOSED else 4 * n)
            omega_squared += (4.0 * K / self.mass) * half_angle**2
        return np.sqrt(omega_squared)

    def shapes(self, modes: ModeSet) -> NDArray[np.float64]:
        """Evaluate mode shapes at every node.

        Returns
        -------
        (nodes, modes) float64
            Each with mean square 1: V'V is the number of nodes times the identity.

        Raises
        ------
        ParameterError
            If a mode lies beyond the lattice's Nyquist wavenumber.
        """
        require_within_zone(modes, self.shape)
        real = np.full((*(1 for _ in self.shape), len(modes)), self.scales(modes))
        imaginary: NDArray[np.float64] | None = None
        for axis, (ends, n) in enumerate(zip(self.topology.ends, self.shape, strict=True)):
            h = modes.half_periods[:, axis]
            along = [1] * len(self.shape) + [len(modes)]
            along[axis] = n
            if ends != CLOSED:
                # cos or sin(h pi s / 2), s = (2n - 1) / 2N
                angle = _products(np.arange(1, 2 * n, 2), h, 8 * n)
                odd = modes.is_odd_at_pole[:, axis]
                factor = np.where(odd, sin_pi(angle, 4 * n), cos_pi(angle, 4 * n))
                real = real * factor.reshape(along)
                imaginary = None if imaginary is None else imaginary * factor.reshape(along)
                continue
            # exp(2 pi i p theta), theta = n / N; the phases of several closed axes add.
            angle = _products(np.arange(1, n + 1), h, n)
            c = cos_pi(2 * angle, n).reshape(along)
            s = sin_pi(2 * angle, n).reshape(along)
            if imaginary is None:
                real, imaginary = real * c, real * s
            else:
                real, imaginary = real * c - imaginary * s, real * s + imaginary * c
        shapes = real if imaginary is None else np.where(modes.is_sine, imaginary, real)
        return shapes.reshape(self.n_nodes, len(modes))

    def scales(self, modes: ModeSet) -> NDArray[np.float64]:
        """Factors that give every shape mean square 1 over the nodes.

        As on a continuum, but for shapes that alternate from node to node: these are +1 and
        -1, with mean square 1 already.
        """
        scale = scales(modes)
        closed = list(self.topology.closed_axes)
        if closed:
            k = modes.wavenumbers[:, closed]
            n = np.array([self.shape[axis] for axis in closed])
            alternates = (2 * k % n == 0).all(axis=1) & (k != 0).any(axis=1)
            scale = np.where(alternates, scale / math.sqrt(2.0), scale)
        for axis, (ends, n) in enumerate(zip(self.topology.ends, self.shape, strict=True)):
            if ends != CLOSED:
                alternates = modes.half_periods[:, axis] == 2 * n
                scale = np.where(alternates, scale / math.sqrt(2.0), scale)
        return scale


def _products(nodes: NDArray[np.int64], h: NDArray[np.int64], period: int) -> NDArray[np.int64]:
    """Products node times h reduced modulo `period` in exact integers, (nodes, modes)."""
    most = int(np.abs(nodes).max(initial=0)) * int(np.abs(h).max(initial=0))
    if most < 2**62:
        return np.multiply.outer(nodes, h) % period
    exact = np.multiply.outer(nodes.astype(object), h.astype(object)) % period
    return exact.astype(np.int64)
