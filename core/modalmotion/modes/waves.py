"""Dispersion relation (7) of lattices and waves that travel on them.

Equation numbers are those of Nastar, INRIA research report, 1994. All closed-form: a lattice
need not be built, and may be of any size.

Each mode is an oscillator with a known motion, so the lattice is known at any time at once,
without steps: Nastar (1994), section 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import NonFiniteError, ParameterError, ShapeError
from modalmotion.modes.lattice import Lattice, require_within_zone
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.oscillators import Oscillators, State
from modalmotion.modes.responses import free_states
from modalmotion.modes.topology import CLOSED, ModeLabel
from modalmotion.modes.transform import project

Array = NDArray[np.float64]
Spacing = float | tuple[float, ...]


def wave_vectors(lattice: Lattice, modes: ModeSet, spacing: Spacing = 1.0) -> Array:
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


def first_zone(lattice: Lattice, k: Array, spacing: Spacing = 1.0) -> Array:
    """Wave vectors of the first Brillouin zone that name the same waves.

    Parameters
    ----------
    lattice : Lattice
    k : (waves, axes) float64, rad per mm
        Of any length.
    spacing : float or tuple of float, mm

    Returns
    -------
    (waves, axes) float64, rad per mm
        From -pi / a to pi / a. Nodes cannot tell k from k + 2 pi / a.
    """
    k = _require_wave_vectors(lattice, k)
    period = 2.0 * np.pi / _spacings(lattice, spacing)
    return np.asarray(k - period * np.rint(k / period))


def dispersion(lattice: Lattice, k: Array, spacing: Spacing = 1.0) -> Array:
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


def phase_velocity(lattice: Lattice, k: Array, spacing: Spacing = 1.0) -> Array:
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


def group_velocity(lattice: Lattice, k: Array, spacing: Spacing = 1.0) -> Array:
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


def _frequencies_along(lattice: Lattice, k: Array, a: Array) -> Array:
    """(7) w_i = 2 sqrt(K_i / M) sin(k_i a_i / 2) along each axis, signed."""
    return np.asarray(2.0 * _rates(lattice) * np.sin(0.5 * k * a))


def _length(vectors: Array) -> Array:
    # hypot, since the square of a small wavenumber may underflow.
    return np.asarray(np.hypot.reduce(vectors, axis=1, initial=0.0))


def _rates(lattice: Lattice) -> Array:
    """sqrt(K / M) of each axis, (axes,) float64."""
    ratios, exponent = lattice.squared_speeds
    speeds: Array = np.ldexp(np.sqrt(ratios), exponent // 2)
    return speeds


def _spacings(lattice: Lattice, spacing: Spacing) -> Array:
    n_axes = lattice.topology.n_axes
    each = spacing if isinstance(spacing, tuple) else (spacing,) * n_axes
    if len(each) != n_axes or not all(math.isfinite(a) and a > 0 for a in each):
        raise ParameterError(
            f"The spacing {spacing} does not place the nodes of {n_axes} axes.",
            remedy="Give one positive distance, or one for each axis.",
        )
    return np.array(each, dtype=np.float64)


def _require_wave_vectors(lattice: Lattice, k: Array) -> Array:
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


def mode_oscillators(lattice: Lattice, modes: ModeSet, damping: Array | float = 0.0) -> Oscillators:
    """Oscillators of the modes of a lattice.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
    damping : (modes,) float64 or float, 1 per time unit

    Returns
    -------
    Oscillators
    """
    return Oscillators(lattice.angular_frequencies(modes), damping)


def modal_state(lattice: Lattice, modes: ModeSet, displacements: Array, velocities: Array) -> State:
    """Expand a lattice's displacements and velocities in modes.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
    displacements : (nodes, ...) float64, mm
    velocities : (nodes, ...) float64, mm per time unit

    Returns
    -------
    State
        (modes, ...) each.

    Raises
    ------
    ShapeError
        If there is not one displacement and one velocity for each node.
    NonFiniteError
        If one is NaN or infinite.
    """
    u, v = (np.asarray(a, dtype=np.float64) for a in (displacements, velocities))
    if u.shape != v.shape or u.shape[:1] != (lattice.n_nodes,):
        raise ShapeError(
            f"Displacements of shape {u.shape} and velocities of shape {v.shape} on "
            f"{lattice.n_nodes} nodes.",
            remedy="Give both with the shape (nodes, ...).",
        )
    both = np.stack([u, v]).reshape(2, lattice.n_nodes, -1)
    a, a_dot = project(lattice, modes, both).reshape(2, len(modes), *u.shape[1:])
    return State(a, a_dot)


def propagate(
    lattice: Lattice,
    modes: ModeSet,
    start: State,
    times: Array,
    damping: Array | float = 0.0,
) -> Iterator[Array]:
    """Displacements of a lattice left to itself, at any times.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
        All of them for the exact motion; few for the slow part of it.
    start : State
        At time 0, (modes, ...) each: from `modal_state` or `travelling_wave`.
    times : (times,) float64, time units
        From 0 on, in any order.
    damping : (modes,) float64 or float, 1 per time unit

    Yields
    ------
    (nodes, ...) float64, mm
        One array for each time.
    """
    shapes = lattice.shapes(modes)
    for state in free_states(mode_oscillators(lattice, modes, damping), times, start):
        a = state.amplitudes
        yield (shapes @ a.reshape(len(modes), -1)).reshape(lattice.n_nodes, *a.shape[1:])


def travelling_wave(
    lattice: Lattice, label: ModeLabel, *, backwards: bool = False
) -> tuple[ModeSet, State]:
    """Start a phonon: one wave that runs through the lattice without changing.

    Its cosine and its sine swing a quarter period apart:
    cos(k x - w t) = cos(k x) cos(w t) + sin(k x) sin(w t). Along open and pole axes the
    wave stands; along closed ones it travels.

    Parameters
    ----------
    lattice : Lattice
    label : ModeLabel
        Either mode of the pair.
    backwards : bool
        Against its wave vector.

    Returns
    -------
    modes : ModeSet
        The cosine and the sine.
    start : State
        (2,) each, for a wave of amplitude 1.

    Raises
    ------
    ParameterError
        If the label has no partner: then there are standing waves only.
    """
    pair = ModeSet.of(
        lattice.topology,
        [ModeLabel(label.wavenumbers, "cos"), ModeLabel(label.wavenumbers, "sin")],
    )
    if not _is_pair(lattice, pair):
        raise ParameterError(
            f"The wave vector of {label} is its own opposite, so its wave stands.",
            remedy="Use a label whose sine is a mode too.",
            details={"label": str(label)},
        )
    w = float(lattice.angular_frequencies(pair)[0])
    return pair, State(np.array([1.0, 0.0]), np.array([0.0, -w if backwards else w]))


def _is_pair(lattice: Lattice, modes: ModeSet) -> bool:
    """Whether k and -k are different waves: 2 p is not a multiple of N on some closed axis."""
    p = modes.wavenumbers[0]
    axes = zip(lattice.topology.ends, lattice.shape, p.tolist(), strict=True)
    return any(ends == CLOSED and 2 * wavenumber % n != 0 for ends, n, wavenumber in axes)
