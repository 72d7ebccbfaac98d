"""Waves on a lattice: free motion from any start, as a sum of its modes.

Each mode is an oscillator with a known motion, so the lattice is known at any time at once,
without steps: Nastar (1994), section 3.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from modalmotion.dynamics.oscillators import Oscillators, State
from modalmotion.dynamics.responses import free_states
from modalmotion.errors import ParameterError, ShapeError
from modalmotion.modes.label import ModeLabel
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.topology import CLOSED
from modalmotion.modes.transform import project, superpose_with

Array = NDArray[np.float64]


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
    factors = lattice.factors(modes)
    for state in free_states(mode_oscillators(lattice, modes, damping), times, start):
        a = state.amplitudes
        u = superpose_with(factors, a.reshape(1, len(modes), -1))
        yield u.reshape(lattice.n_nodes, *a.shape[1:])


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
