"""The general harmonic potential (4) and the dynamical matrix of its waves.

With directions coupled the 3 N modes of a lattice still need no large eigenproblem: one of
3 x 3 for each wave vector: waves e exp(i(k n - w t)) in the forces (5) leave (6) w^2 e = D(k) e.
Nastar (1994); Born and Huang, Dynamical Theory of Crystal Lattices, 1954.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.checking import whole_numbers
from modalmotion.errors import ParameterError, ShapeError, TopologyError
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import Topology, require_shape
from modalmotion.modes.trigonometry import cos_pi, sin_pi
from modalmotion.representation import FrozenArrays, shown

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
        out: a potential does not feel where the whole lattice is.
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


ComplexArray = NDArray[np.complex128]

# Rounding of D and of its eigenvalues, in units of eps times the size of D.
_ROUNDING: Final = 64.0


@shown("angular_frequencies", "polarisations")
class PolarisedWaves(NamedTuple):
    """The three waves of each wave vector, slow ones first.

    Parameters
    ----------
    angular_frequencies : (waves, 3) float64, rad per time unit
        Good to some eps of the fastest branch in w^2: a branch slower by 1e-8 is rounding.
    polarisations : (waves, 3, 3) complex128
        Unit vectors e[wave, direction, branch]; the displacement is Re[e exp(i(k n - w t))].
        Real where K(l) is symmetric. The first of the largest entries is real and positive;
        branches of equal frequency are some orthonormal basis of their space.
    """

    angular_frequencies: Array
    polarisations: ComplexArray


def dynamical_matrices(
    potential: HarmonicPotential, wavenumbers: NDArray[np.int64]
) -> ComplexArray:
    """Dynamical matrix of each wave vector, D(k) = sum K(l) exp(i k l) / M.

    Parameters
    ----------
    potential : HarmonicPotential
    wavenumbers : (waves, axes) int64
        Periods along each axis.

    Returns
    -------
    (waves, 3, 3) complex128, 1 per time unit squared
        Exactly Hermitian, and exactly 0 at k = 0.

    Raises
    ------
    ShapeError
        If the wavenumbers are not integers of that shape.
    """
    matrices, _ = _matrices(potential, wavenumbers)
    return matrices


def polarised_waves(potential: HarmonicPotential, wavenumbers: NDArray[np.int64]) -> PolarisedWaves:
    """Frequencies and polarisations of the waves of each wave vector.

    Parameters
    ----------
    potential : HarmonicPotential
    wavenumbers : (waves, axes) int64
        Periods along each axis, `ModeSet.wavenumbers` for instance.

    Returns
    -------
    PolarisedWaves

    Raises
    ------
    ShapeError
        If the wavenumbers are not integers of that shape.
    ParameterError
        If the potential has no minimum along a wave (w^2 < 0), which it names.
    """
    D, size = _matrices(potential, wavenumbers)
    # (6) w^2 e = D(k) e
    w_squared, e = np.linalg.eigh(D)
    least = -_ROUNDING * float(np.finfo(np.float64).eps) * size
    unstable = np.flatnonzero((w_squared < least[:, None]).any(axis=1))
    if unstable.size:
        wave = int(unstable[0])
        p = np.asarray(wavenumbers)[wave].tolist()
        raise ParameterError(
            f"The wave of wavenumbers {tuple(p)} has w^2 = {w_squared[wave, 0]}: the lattice "
            "would leave its rest position and never return.",
            remedy="Use force constants whose potential is nowhere below its value at rest.",
            details={"wavenumbers": p},
        )
    return PolarisedWaves(np.sqrt(np.maximum(w_squared, 0.0)), _fixed_phase(e))


def wave_field(
    potential: HarmonicPotential, wavenumbers: tuple[int, ...], polarisation: ComplexArray
) -> ComplexArray:
    """Displacements of one wave at every node, as a complex field.

    Parameters
    ----------
    potential : HarmonicPotential
    wavenumbers : tuple of int
        One for each axis.
    polarisation : (3,) complex128, mm

    Returns
    -------
    (nodes, 3) complex128, mm
        e exp(i k n), n counted from 1 as on a `Lattice`. The wave at time t is the real part
        of this times exp(-i w t).
    """
    turn = math.lcm(*potential.shape)
    phase = np.zeros(potential.shape, dtype=np.int64)
    for axis, (p, n) in enumerate(zip(wavenumbers, potential.shape, strict=True)):
        along = [1] * len(potential.shape)
        along[axis] = n
        phase = phase + ((p * np.arange(1, n + 1)) % n * (turn // n)).reshape(along)
    angle = 2 * (phase.ravel() % turn)
    return (cos_pi(angle, turn) + 1j * sin_pi(angle, turn))[:, None] * polarisation


def _matrices(
    potential: HarmonicPotential, wavenumbers: NDArray[np.int64]
) -> tuple[ComplexArray, Array]:
    """D(k), and the sum of the sizes of its terms, (waves,)."""
    p = np.asarray(wavenumbers)
    n_axes = potential.topology.n_axes
    if p.ndim != 2 or p.shape[1] != n_axes or p.dtype.kind not in "iu":
        raise ShapeError(
            f"Wavenumbers are integers of shape (waves, {n_axes}), not {p.dtype} of {p.shape}.",
            remedy="Give whole periods along each axis.",
        )
    # k l = 2 pi sum p_i l_i / N_i as a whole number of parts of a turn: nothing is lost.
    turn = math.lcm(*potential.shape)
    parts = np.zeros((len(p), len(potential.offsets)), dtype=np.int64)
    for axis, n in enumerate(potential.shape):
        offsets = potential.offsets[:, axis] % n
        parts = (parts + np.multiply.outer(p[:, axis] % n, offsets) % n * (turn // n)) % turn
    # l and -l together: -(K + K') (1 - cos k l) + i (K - K') sin k l, and K(0), minus the sum
    # of all, is in the 1. 1 - cos as 2 sin^2, which long waves need.
    even = 2.0 * sin_pi(parts, turn) ** 2 / potential.mass
    odd = sin_pi(2 * parts, turn) / potential.mass
    K, K_t = potential.constants, potential.constants.transpose(0, 2, 1)
    D = np.einsum("kl,lij->kij", even, -(K + K_t)) + 1j * np.einsum("kl,lij->kij", odd, K - K_t)
    strength = 2.0 * np.abs(potential.constants).max(axis=(1, 2), initial=0.0)
    return D, 3.0 * (even + np.abs(odd) * _is_coupled(potential)) @ strength


def _is_coupled(potential: HarmonicPotential) -> NDArray[np.bool_]:
    """Which force constants are not symmetric."""
    K = potential.constants
    return np.asarray((K.transpose(0, 2, 1) != K).any(axis=(1, 2)))


def _fixed_phase(e: ComplexArray) -> ComplexArray:
    """Turn each vector until the first of its largest entries is real and positive."""
    size = np.abs(e)
    # Entries that are equal but for rounding count as equal, so that the first is taken.
    largest = (size >= size.max(axis=1, keepdims=True) * (1.0 - 1e-9)).argmax(axis=1)
    entry = np.take_along_axis(e, largest[:, None, :], axis=1)
    return np.asarray(e * (np.conj(entry) / np.abs(entry)))
