"""The general harmonic potential: force constants that couple directions and neighbours."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, TopologyError
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.order import require_shape
from modalmotion.modes.topology import Topology
from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.numeric.kinds import whole_numbers
from modalmotion.representation import shown

Array = NDArray[np.float64]
Offset = tuple[int, ...]

# Force constants up to this can be added.
_LARGEST: Final = 1e300

_TOLERANCE: Final = 1e-12


@shown()
@dataclass(frozen=True, eq=False)
class HarmonicPotential(FrozenArrays):
    """Harmonic potential of a lattice on closed axes, Nastar (1994), (4) and (5).

    (4) V = 1/2 sum u_n' K(l) u_(n + l) over all nodes n and offsets l, so the force on node n is
    (5) f_n = -sum K(l) u_(n + l). The K(l) are the blocks of the stiffness matrix K of (1); a
    spring K to a neighbour has K(l) = -K there.

    Parameters
    ----------
    topology : Topology
        All axes closed; others have no wave vectors in three directions at once.
    shape : tuple of int
        Nodes along each axis.
    force_constants : mapping of offset to (3, 3) float64, force per length
        K(l) for each offset l, a tuple of int, one for each axis. K(-l) is the transpose
        of K(l) and may be left out. K(0) is minus the sum of all others and may be left
        out: a potential does not feel where the whole lattice lies.
    mass : float
        M of one node.

    Raises
    ------
    TopologyError
        If an axis is not closed.
    ParameterError
        If an offset or a matrix has the wrong shape or is not finite, K(-l) is not the
        transpose of K(l), K(0) does not balance the others, or the mass is not positive.
    """

    topology: Topology
    shape: tuple[int, ...]
    force_constants: Mapping[Offset, Array]
    mass: float = 1.0

    def __post_init__(self) -> None:
        if len(self.topology.closed_axes) != self.topology.n_axes:
            raise TopologyError(
                f"A {self.topology} has ends, where the force constants would differ.",
                remedy="Use closed axes only, or a Lattice, whose directions are uncoupled.",
            )
        object.__setattr__(self, "shape", whole_numbers("shape", self.shape))
        require_shape(self.topology, self.shape)
        if not (math.isfinite(self.mass) and self.mass > 0):
            raise ParameterError(
                f"The mass M is {self.mass}, but only nodes with a mass oscillate.",
                remedy="Use a value above zero.",
            )
        _require_frequencies(self.force_constants, self.mass)
        constants = _completed(self.force_constants, self.topology.n_axes)
        object.__setattr__(self, "force_constants", constants)

    @staticmethod
    def decoupled(lattice: Lattice) -> HarmonicPotential:
        """Potential of a lattice whose directions are uncoupled: springs to next neighbours.

        Raises
        ------
        TopologyError
            If an axis of the lattice is not closed.
        """
        n_axes = lattice.topology.n_axes
        constants = {
            tuple(int(i == axis) for i in range(n_axes)): -K * np.eye(3)
            for axis, K in enumerate(lattice.stiffnesses)
        }
        return HarmonicPotential(lattice.topology, lattice.shape, constants, lattice.mass)

    @cached_property
    def offsets(self) -> NDArray[np.int64]:
        """One offset of each pair l, -l.

        Returns
        -------
        (pairs, axes) int64
        """
        half = [offset for offset in self.force_constants if offset > _opposite(offset)]
        return np.array(half, dtype=np.int64).reshape(len(half), self.topology.n_axes)

    @cached_property
    def constants(self) -> Array:
        """Force constants of `offsets`.

        Returns
        -------
        (pairs, 3, 3) float64, force per length
        """
        half = [self.force_constants[tuple(offset)] for offset in self.offsets.tolist()]
        return np.array(half, dtype=np.float64).reshape(len(half), 3, 3)


def _require_frequencies(force_constants: Mapping[Offset, Array], mass: float) -> None:
    """Refuse constants whose sums, or squared frequencies, are beyond the largest number."""
    largest = max(
        (float(np.abs(np.asarray(K, dtype=np.float64)).max(initial=0.0)))
        for K in (0.0, *force_constants.values())
    )
    with np.errstate(over="ignore"):
        # No w^2 exceeds the sizes of all terms of D(k), both signs of each offset.
        bound = np.float64(largest) * (12.0 * (2 * len(force_constants) + 1)) / np.float64(mass)
    if largest < np.inf and not (largest < _LARGEST and np.isfinite(bound)):
        raise ParameterError(
            f"Force constants up to {largest:.3g} with the mass {mass:.3g} make frequencies whose "
            "squares are beyond the largest number.",
            remedy="State them in another unit of time, which changes the constants alone.",
        )


def _completed(force_constants: Mapping[Offset, Array], n_axes: int) -> dict[Offset, Array]:
    """All force constants, K(-l) and K(0) included."""
    constants: dict[Offset, Array] = {}
    for offset, matrix in force_constants.items():
        n = tuple(int(entry) for entry in offset)
        K = np.array(matrix, dtype=np.float64)
        if len(n) != n_axes or K.shape != (3, 3) or not np.isfinite(K).all():
            raise ParameterError(
                f"The force constants at offset {offset} have the shape {K.shape} and the "
                f"values {K.tolist()}.",
                remedy=f"Give a finite (3, 3) matrix for each offset of {n_axes} integers.",
            )
        constants[n] = K
    scale = float(sum(np.abs(K).max() for K in constants.values()))
    zero = (0,) * n_axes
    own = constants.pop(zero, None)
    for n, K in list(constants.items()):
        opposite = constants.setdefault(_opposite(n), K.T.copy())
        if np.abs(opposite - K.T).max() > _TOLERANCE * scale:
            raise ParameterError(
                f"The force constants at {_opposite(n)} are not the transpose of those at {n}: "
                "such forces derive from no potential, and action is not reaction.",
                remedy="Leave one of the two out, and it is filled in.",
                details={"offset": list(n)},
            )
    balance = -np.sum([np.zeros((3, 3)), *constants.values()], axis=0)
    if own is not None and np.abs(own - balance).max() > _TOLERANCE * scale:
        raise ParameterError(
            "The force constants at offset 0 do not balance the others: moving the whole "
            "lattice would take a force (acoustic sum rule).",
            remedy="Leave them out, and they are filled in.",
        )
    constants[zero] = balance
    for K in constants.values():
        K.setflags(write=False)
    return constants


def _opposite(offset: Offset) -> Offset:
    return tuple(-entry for entry in offset)
