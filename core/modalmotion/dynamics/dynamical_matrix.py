"""The dynamical matrix D(k) of a harmonic potential, and its three polarisations.

With directions coupled the 3 N modes of a lattice still need no large eigenproblem: one of
3 x 3 for each wave vector: waves e exp(i(k n - w t)) in the forces (5) leave (6) w^2 e = D(k) e.
Nastar (1994); Born and Huang, Dynamical Theory of Crystal Lattices, 1954.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.dynamics.potential import HarmonicPotential
from modalmotion.errors import ParameterError, ShapeError
from modalmotion.modes.trigonometry import cos_pi, sin_pi
from modalmotion.representation import shown

Array = NDArray[np.float64]
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
