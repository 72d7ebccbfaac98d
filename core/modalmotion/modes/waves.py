"""Dispersion relation (7) of lattices, and waves of the general harmonic potential (4).

Equation numbers are those of Nastar, INRIA research report, 1994. All closed-form: a lattice
need not be built, and may be of any size.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from modalmotion.errors import NonFiniteError, ParameterError, ShapeError
from modalmotion.modes.lattice import Lattice, require_within_zone, sin_pi
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.topologies import CLOSED
from modalmotion.representation import Complexes, Floats, Ints

Spacing = float | tuple[float, ...]


def wave_vectors(lattice: Lattice, modes: ModeSet, spacing: Spacing = 1.0) -> Floats:
    """Wave vector of each mode, in the first Brillouin zone.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
    spacing : float or tuple of float, mm
        Distance a of neighbouring nodes, one for all axes or one for each.

    Returns
    -------
    (modes, axes) float64, rad per mm
        From above -pi / a to pi / a on closed axes, from 0 to pi / a on others.

    Raises
    ------
    ParameterError
        If a mode is beyond the zone, where it would repeat another, or a spacing is not
        positive and finite.
    """
    require_within_zone(modes, lattice.shape)
    a = _spacings(lattice, spacing)
    k = np.empty(modes.wavenumbers.shape)
    for axis, (ends, n) in enumerate(zip(lattice.topology.ends, lattice.shape, strict=True)):
        # k a = 2 pi p / N closed, h pi / 2N else
        turn = 2.0 * np.pi if ends == CLOSED else np.pi / 2.0
        k[:, axis] = turn * (modes.half_periods[:, axis] / n) / a[axis]
    return k


def dispersion(lattice: Lattice, k: Floats, spacing: Spacing = 1.0) -> Floats:
    """Angular frequency of waves on a lattice, the dispersion relation (7) summed over the axes.

    Parameters
    ----------
    lattice : Lattice
        Its stiffnesses and its mass; the number of its nodes does not matter.
    k : (waves, axes) float64, rad per mm
    spacing : float or tuple of float, mm

    Returns
    -------
    (waves,) float64, rad per time unit

    Raises
    ------
    ShapeError, NonFiniteError
        If `k` does not contain one finite number for each axis.
    """
    k = _require_wave_vectors(lattice, k)
    return _length(_frequencies_along(lattice, k, _spacings(lattice, spacing)))


def phase_velocity(lattice: Lattice, k: Floats, spacing: Spacing = 1.0) -> Floats:
    """Speed w / |k| at which the crests of a wave travel.

    Parameters
    ----------
    lattice : Lattice
    k : (waves, axes) float64, rad per mm
    spacing : float or tuple of float, mm

    Returns
    -------
    (waves,) float64, mm per time unit
        At k = 0 its limit a sqrt(K / M) on one axis; 0 on several, where no limit exists.
    """
    k = _require_wave_vectors(lattice, k)
    a = _spacings(lattice, spacing)
    wavenumber = _length(k)
    at_rest = wavenumber == 0
    w = _length(_frequencies_along(lattice, k, a))
    limit = a[0] * _rates(lattice)[0] if k.shape[1] == 1 else 0.0
    return np.where(at_rest, limit, w / np.where(at_rest, 1.0, wavenumber))


def group_velocity(lattice: Lattice, k: Floats, spacing: Spacing = 1.0) -> Floats:
    """Velocity dw / dk at which a pulse of waves, and its energy, travels.

    Parameters
    ----------
    lattice : Lattice
    k : (waves, axes) float64, rad per mm
    spacing : float or tuple of float, mm

    Returns
    -------
    (waves, axes) float64, mm per time unit
        At k = 0 its limit from above a sqrt(K / M) on one axis; 0 on several, where the
        limit depends on the direction.
    """
    k = _require_wave_vectors(lattice, k)
    a = _spacings(lattice, spacing)
    w_along = _frequencies_along(lattice, k, a)
    w = _length(w_along)[:, None]
    # dw / dk_i = a_i sqrt(K_i / M) cos(k_i a_i / 2) w_i / w, w^2 = sum w_i^2
    share = np.where(w == 0, float(k.shape[1] == 1), w_along / np.where(w == 0, 1.0, w))
    return np.asarray(a * _rates(lattice) * np.cos(0.5 * k * a) * share)


def _frequencies_along(lattice: Lattice, k: Floats, a: Floats) -> Floats:
    """(7) w_i = 2 sqrt(K_i / M) sin(k_i a_i / 2) along each axis, signed."""
    return np.asarray(2.0 * _rates(lattice) * np.sin(0.5 * k * a))


def _length(vectors: Floats) -> Floats:
    # hypot, since the square of a small wavenumber may underflow.
    return np.asarray(np.hypot.reduce(vectors, axis=1, initial=0.0))


def _rates(lattice: Lattice) -> Floats:
    """sqrt(K / M) of each axis, (axes,) float64."""
    ratios, exponent = lattice.squared_speeds
    return np.asarray(np.ldexp(np.sqrt(ratios), exponent // 2))


def _spacings(lattice: Lattice, spacing: Spacing) -> Floats:
    n_axes = lattice.topology.n_axes
    each = spacing if isinstance(spacing, tuple) else (spacing,) * n_axes
    if len(each) != n_axes or not all(math.isfinite(a) and a > 0 for a in each):
        raise ParameterError(
            f"The spacing {spacing} does not place the nodes of {n_axes} axes.",
            remedy="Give one positive distance, or one for each axis.",
        )
    return np.array(each, dtype=np.float64)


def _require_wave_vectors(lattice: Lattice, k: Floats) -> Floats:
    k = np.asarray(k, dtype=np.float64)
    if k.ndim != 2 or k.shape[1] != lattice.topology.n_axes:
        raise ShapeError(
            f"Wave vectors of shape {k.shape} on a lattice of {lattice.topology.n_axes} axes.",
            remedy="Give the shape (waves, axes).",
        )
    if not np.isfinite(k).all():
        wave = int(np.argwhere(~np.isfinite(k))[0, 0])
        raise NonFiniteError(
            f"Wave vector {wave} is {k[wave]}.",
            remedy="Use finite wave vectors.",
            details={"wave": wave},
        )
    return k


# Rounding of the eigenvalues of D, in units of eps times the size of its terms.
_ROUNDING: Final = 64.0


def dynamical_matrices(
    shape: tuple[int, ...],
    force_constants: Mapping[Any, Floats],
    wavenumbers: Ints,
    mass: float = 1.0,
) -> Complexes:
    """Dynamical matrix of each wave vector, D(k) = sum K(l) exp(i k l) / M.

    The general harmonic potential (4) V = sum u_n' K(l) u_(n+l) / 2 of a lattice on closed axes,
    whose forces (5) couple directions and reach beyond the next neighbour.

    Parameters
    ----------
    shape : tuple of int
        Nodes along each closed axis.
    force_constants : mapping of tuple of int to (3, 3) float64
        K(l) of one of each pair l, -l: K(-l) is its transpose, and K(0) is minus the sum of all
        (acoustic sum rule). Springs of stiffness k to the next neighbour are K = -k I.
    wavenumbers : (waves, axes) int64
        Whole periods along each axis.
    mass : float

    Returns
    -------
    (waves, 3, 3) complex128, hermitian

    Raises
    ------
    ParameterError
        If a matrix is not (3, 3) and finite, an offset and its opposite are both given, or the
        mass or a number of nodes is not positive.
    ShapeError
        If the wavenumbers are not integers of shape (waves, axes).
    """
    for offset, K in force_constants.items():
        twice = tuple(-entry for entry in offset) in force_constants
        if twice or len(offset) != len(shape) or np.shape(K) != (3, 3) or not np.isfinite(K).all():
            raise ParameterError(
                f"The force constants at offset {offset} are {np.asarray(K).tolist()}.",
                remedy="Give a finite (3, 3) matrix for one of each pair of opposite offsets.",
            )
    if not (math.isfinite(mass) and mass > 0):
        raise ParameterError(f"The mass M is {mass}.", remedy="Use a finite mass above zero.")
    if min(shape, default=0) < 1:
        raise ParameterError(
            f"A lattice has no shape {shape}.", remedy="Give a node or more along each axis."
        )
    p = np.asarray(wavenumbers)
    if p.ndim != 2 or p.shape[1] != len(shape) or p.dtype.kind not in "iu":
        raise ShapeError(
            f"Wavenumbers are integers of shape (waves, {len(shape)}), not {p.dtype} of {p.shape}.",
            remedy="Give whole periods along each axis.",
        )
    n_offsets = len(force_constants)
    offsets = np.array(list(force_constants), dtype=np.int64).reshape(n_offsets, len(shape))
    constants = np.array(list(force_constants.values()), dtype=np.float64).reshape(-1, 3, 3)
    # k l = 2 pi sum p_i l_i / N_i as a whole number of parts of a turn: nothing is lost.
    turn = math.lcm(*shape)
    parts = np.zeros((len(p), n_offsets), dtype=np.int64)
    for axis, n in enumerate(shape):
        along = np.multiply.outer(p[:, axis] % n, offsets[:, axis] % n) % n
        parts = (parts + along * (turn // n)) % turn
    # l and -l together: -(K + K') (1 - cos k l) + i (K - K') sin k l, and K(0), minus the sum
    # of all, is in the 1. 1 - cos as 2 sin^2, which long waves need.
    even, odd = 2.0 * sin_pi(parts, turn) ** 2, sin_pi(2 * parts, turn)
    with np.errstate(over="ignore", invalid="ignore"):
        K, K_t = constants / mass, constants.transpose(0, 2, 1) / mass
        D = np.einsum("kl,lij->kij", even, -(K + K_t)) + 1j * np.einsum("kl,lij->kij", odd, K - K_t)
    if not np.isfinite(D).all():
        raise ParameterError(
            f"With the mass {mass:g} these force constants make frequencies whose squares are "
            "beyond the largest number.",
            remedy="State them in another unit of time, which changes the constants alone.",
        )
    return np.asarray(D, dtype=np.complex128)


def polarised_waves(
    shape: tuple[int, ...],
    force_constants: Mapping[Any, Floats],
    wavenumbers: Ints,
    mass: float = 1.0,
) -> tuple[Floats, Complexes]:
    """Frequencies and polarisations of the three waves of each wave vector, slow ones first.

    Parameters
    ----------
    shape, force_constants, wavenumbers, mass
        See `dynamical_matrices`.

    Returns
    -------
    angular_frequencies : (waves, 3) float64, rad per time unit
    polarisations : (waves, 3, 3) complex128
        Columns e of length 1: wave j moves node n by e_j exp(i (k n - w_j t)). The first of the
        largest entries of each is real and positive.

    Raises
    ------
    ParameterError
        If the potential falls below its value at rest: the lattice would not return.
    """
    D = dynamical_matrices(shape, force_constants, wavenumbers, mass)
    # (6) w^2 e = D(k) e
    w_squared, e = np.linalg.eigh(D)
    size = sum(4.0 * float(np.abs(K).sum()) for K in force_constants.values()) / mass
    unstable = np.flatnonzero(w_squared[:, 0] < -_ROUNDING * float(np.finfo(np.float64).eps) * size)
    if unstable.size:
        p = np.asarray(wavenumbers)[unstable[0]].tolist()
        raise ParameterError(
            f"The wave of wavenumbers {tuple(p)} has w^2 = {w_squared[unstable[0], 0]}: the "
            "lattice would leave its rest position and never return.",
            remedy="Use force constants whose potential is nowhere below its value at rest.",
            details={"wavenumbers": p},
        )
    return np.sqrt(np.maximum(w_squared, 0.0)), _fixed_phase(e)


def _fixed_phase(e: Complexes) -> Complexes:
    """Turn each vector until the first of its largest entries is real and positive."""
    size = np.abs(e)
    # Entries that are equal but for rounding count as equal, so that the first is taken.
    largest = (size >= size.max(axis=1, keepdims=True) * (1.0 - 1e-9)).argmax(axis=1)
    entry = np.take_along_axis(e, largest[:, None, :], axis=1)
    return np.asarray(e * (np.conj(entry) / np.abs(entry)))
