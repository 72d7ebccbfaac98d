"""Damped oscillators, one per mode: equation (3), dampings, modal forces and animation.

As figures 2 and 3 of Nastar (1994). The modes may be of anything: shapes at the nodes of a
lattice or at the vertices of a mesh serve alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.representation import FrozenArrays, shown


@shown()
@dataclass(frozen=True, eq=False)
class State:
    """Displacements and velocities of oscillators.

    Parameters
    ----------
    amplitudes : (modes, ...) float64, mm
        u of each mode, in as many directions as the caller has.
    velocities : (modes, ...) float64, mm per time unit
        u'.
    amplitude_rests, velocity_rests : (modes, ...) float64 or 0
        Rounding error of the last step. A step hands it on to the next, so that many
        small steps are as exact as few large ones. Only steps need it.
    """

    amplitudes: NDArray[np.float64]
    velocities: NDArray[np.float64]
    amplitude_rests: NDArray[np.float64] | float = 0.0
    velocity_rests: NDArray[np.float64] | float = 0.0


@shown()
@dataclass(frozen=True, eq=False)
class Oscillators(FrozenArrays):
    """Independent oscillators (3) u'' + c u' + w^2 u = f, one for each mode.

    The equations of motion (1) M U'' + C U' + K U = F in modes, U = Phi u by (2), where the
    damping C leaves them uncoupled. Equation numbers are those of Nastar (1994).

    Parameters
    ----------
    angular_frequencies : (modes,) float64, rad per time unit
        w. 0 is a rigid mode.
    damping : (modes,) float64 or float, 1 per time unit
        c, damping per unit mass; critical at c = 2w.

    Raises
    ------
    ParameterError
        If a frequency or a damping is negative or not finite.
    ShapeError
        If they do not name one oscillator for each mode.
    """

    angular_frequencies: NDArray[np.float64]
    damping: NDArray[np.float64] | float = 0.0

    def __post_init__(self) -> None:
        w = np.array(self.angular_frequencies, dtype=np.float64)
        c = np.array(self.damping, dtype=np.float64)
        if w.ndim != 1 or c.shape not in ((), w.shape):
            raise ShapeError(
                f"Frequencies of shape {w.shape} with dampings of shape {c.shape} name no "
                "oscillators.",
                remedy="Give one frequency for each mode, and one damping for all or for each.",
            )
        c = np.array(np.broadcast_to(c, w.shape))
        for name, values in (("angular frequency", w), ("damping", c)):
            wrong = np.flatnonzero(~(np.isfinite(values) & (values >= 0)))
            if wrong.size:
                mode = int(wrong[0])
                raise ParameterError(
                    f"The {name} of mode {mode} is {values[mode]}; below zero a motion grows "
                    "without end, and a value that is not finite describes none.",
                    remedy="Use finite values from zero on.",
                    details={"mode": mode},
                )
            values.setflags(write=False)
        object.__setattr__(self, "angular_frequencies", w)
        object.__setattr__(self, "damping", c)

    def __len__(self) -> int:
        return len(self.angular_frequencies)

    @property
    def dampings(self) -> NDArray[np.float64]:
        """Damping c of each mode.

        Returns
        -------
        (modes,) float64, 1 per time unit
        """
        return np.asarray(self.damping, dtype=np.float64)


def energy(oscillators: Oscillators, state: State) -> NDArray[np.float64]:
    """Kinetic and strain energy of each mode, per unit mass.

    Parameters
    ----------
    oscillators : Oscillators
    state : State
        (modes, ...) each.

    Returns
    -------
    (modes, ...) float64, mm^2 per time unit squared
    """
    state = require_state(oscillators, state)
    # (v^2 + w^2 u^2) / 2, the square taken last so that w alone cannot overflow.
    w = per_mode(oscillators.angular_frequencies, state.amplitudes)
    return 0.5 * (state.velocities**2 + (w * state.amplitudes) ** 2)


def phase_error(oscillators: Oscillators, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bound on the error of each oscillator's phase: eps w t.

    A frequency known to one float is uncertain by half a unit in its last place, so after a
    time t the phase w t is uncertain by eps w t / 2 however it is computed; steps add as
    much again. At w t = 4.5e15 the phase means nothing. Energy is not affected.

    Parameters
    ----------
    oscillators : Oscillators
    times : (times,) float64, time units

    Returns
    -------
    (times, modes) float64, rad
    """
    t = require_times(times)
    eps = float(np.finfo(np.float64).eps)
    return np.multiply.outer(t, eps * oscillators.angular_frequencies)


def require_state(oscillators: Oscillators, state: State) -> State:
    """Return the state as float64 arrays of one shape, one row for each mode.

    Raises
    ------
    ShapeError
        If amplitudes and velocities differ in shape, or do not have one row for each mode.
    """
    u = np.asarray(state.amplitudes, dtype=np.float64)
    v = np.asarray(state.velocities, dtype=np.float64)
    if u.shape != v.shape or u.shape[:1] != (len(oscillators),):
        raise ShapeError(
            f"Amplitudes of shape {u.shape} and velocities of shape {v.shape} do not describe "
            f"{len(oscillators)} oscillators.",
            remedy="Give both with the shape (modes, ...).",
        )
    return State(u, v, state.amplitude_rests, state.velocity_rests)


def require_times(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return times as float64.

    Raises
    ------
    ShapeError
        If they are not one-dimensional.
    ParameterError
        If one is negative or not finite.
    """
    t = np.asarray(times, dtype=np.float64)
    if t.ndim != 1:
        raise ShapeError(
            f"Times have the shape {t.shape}, not (times,).",
            remedy="Give a one-dimensional array.",
        )
    wrong = np.flatnonzero(~(np.isfinite(t) & (t >= 0)))
    if wrong.size:
        frame = int(wrong[0])
        raise ParameterError(
            f"Time {frame} is {t[frame]}; a damped motion is known from its start on, for "
            "finite times.",
            remedy="Count finite times from the start, which is 0.",
            frame=frame,
        )
    return t


def per_mode(values: NDArray[np.float64], like: NDArray[np.float64]) -> NDArray[np.float64]:
    """One value for each mode, shaped to multiply (modes, ...)."""
    return values.reshape(values.shape + (1,) * (like.ndim - 1))


def nodal_damping(coefficient: float, mass: float = 1.0) -> float:
    """Damping of every mode when each node moves through a viscous medium.

    Parameters
    ----------
    coefficient : float, force per velocity
        C at each node.
    mass : float
        M of one node.

    Returns
    -------
    float, 1 per time unit
        c = C / M, the same for all modes.

    Raises
    ------
    ParameterError
        If the coefficient is negative, the mass not positive, or one not finite.
    """
    if not (math.isfinite(coefficient) and coefficient >= 0 and math.isfinite(mass) and mass > 0):
        raise ParameterError(
            f"A damping of {coefficient} at nodes of mass {mass} does not damp.",
            remedy="Use a finite damping from zero on and a finite mass above zero.",
        )
    return coefficient / mass


def rayleigh_damping(
    angular_frequencies: NDArray[np.float64], alpha: float, beta: float
) -> NDArray[np.float64]:
    """Damping proportional to mass and to stiffness.

    Parameters
    ----------
    angular_frequencies : (modes,) float64, rad per time unit
    alpha : float, 1 per time unit
        Share of the mass matrix: all modes alike.
    beta : float, time units
        Share of the stiffness matrix: fast modes most.

    Returns
    -------
    (modes,) float64, 1 per time unit

    Raises
    ------
    ParameterError
        If alpha or beta is negative or not finite.

    Notes
    -----
    Rayleigh, The Theory of Sound, 1877, section 97.
    """
    if not all(math.isfinite(share) and share >= 0 for share in (alpha, beta)):
        raise ParameterError(
            f"Rayleigh damping with alpha = {alpha} and beta = {beta} would feed some modes.",
            remedy="Use finite values from zero on.",
        )
    w = np.asarray(angular_frequencies, dtype=np.float64)
    # c = alpha + beta w^2
    return alpha + beta * w**2


def modal_forces(
    shapes: NDArray[np.float64], forces: NDArray[np.float64], mass: float = 1.0
) -> NDArray[np.float64]:
    """Force on each mode per unit modal mass, the f = Phi' F of Nastar (1994), (3).

    On a lattice `modalmotion.modes.transform.project` does the same faster: f = project(F) / M.

    Parameters
    ----------
    shapes : (nodes, modes) float64
        Phi, each with mean square 1, as `Lattice.shapes` gives it.
    forces : (nodes, ...) float64, mass times mm per time unit squared
        F at each node, in as many directions as the caller has.
    mass : float
        M of one node.

    Returns
    -------
    (modes, ...) float64, mm per time unit squared
        The same bits on any number of threads.

    Raises
    ------
    ShapeError
        If there is not one force for each node.
    ParameterError
        If the mass is not positive and finite.
    """
    if shapes.ndim != 2 or len(forces) != len(shapes):
        raise ShapeError(
            f"Forces of shape {forces.shape} do not fit shapes of shape {shapes.shape}.",
            remedy="Give one force for each node.",
        )
    if not (math.isfinite(mass) and mass > 0):
        raise ParameterError(
            f"Nodes of mass {mass} cannot be accelerated.", remedy="Use a mass above zero."
        )
    # The shapes' mean square is 1, so Phi' M Phi = M N: f = Phi' F / (M N).
    phi, F = (np.asarray(a, dtype=np.float64) for a in (shapes, forces))
    f = (phi.T @ F.reshape(len(F), -1)) / (mass * len(phi))
    return f.reshape(phi.shape[1], *F.shape[1:])


Array = NDArray[np.float64]


def directional_mode(shape: Array, direction: Array) -> Array:
    """Displacements of a mode along one direction.

    Parameters
    ----------
    shape : (vertices,) float64
        One column of a shape matrix.
    direction : (3,) or (vertices, 3) float64
        A unit vector for all vertices, or one for each, such as their normals.

    Returns
    -------
    (vertices, 3) float64

    Raises
    ------
    ShapeError
        If the direction has another shape.
    """
    phi = np.asarray(shape, dtype=np.float64)
    if phi.ndim != 1:
        raise ShapeError(
            f"A mode has the shape (vertices,), not {phi.shape}.",
            remedy="Take one column of the shape matrix.",
        )
    return phi[:, None] * _require_direction(direction, len(phi))


def animate_along(
    reference: Array, shapes: Array, amplitudes: Iterable[Array], direction: Array
) -> Iterator[Array]:
    """Positions of a shape that moves by directional modes.

    Parameters
    ----------
    reference : (vertices, 3) float64, mm
    shapes : (vertices, modes) float64
    amplitudes : iterable of (modes,) float64, mm
        One for each frame.
    direction : (3,) or (vertices, 3) float64
        A unit vector for all vertices, or one for each, such as their normals.

    Yields
    ------
    (vertices, 3) float64, mm

    Raises
    ------
    ShapeError
        If the arrays do not fit; names the frame.
    """
    X, phi = _require_basis(reference, shapes)
    d = _require_direction(direction, len(X))
    # (2) x = X + sum_m a_m phi_m d
    return (X + (phi @ a[:, None]) * d for a in _each(amplitudes, (phi.shape[1],)))


def _each(amplitudes: Iterable[Array], shape: tuple[int, ...]) -> Iterator[Array]:
    for frame, values in enumerate(amplitudes):
        a = np.asarray(values, dtype=np.float64)
        if a.shape != shape:
            raise ShapeError(
                f"The amplitudes of frame {frame} have the shape {a.shape}, not {shape}.",
                remedy="Give one amplitude for each mode and direction.",
                frame=frame,
            )
        yield a


def _require_basis(reference: Array, shapes: Array) -> tuple[Array, Array]:
    X, phi = (np.asarray(a, dtype=np.float64) for a in (reference, shapes))
    if X.ndim != 2 or X.shape[1] != 3 or phi.ndim != 2 or len(phi) != len(X):
        raise ShapeError(
            f"A reference of shape {X.shape} cannot move by shapes of shape {phi.shape}.",
            remedy="Give (vertices, 3) and (vertices, modes).",
        )
    return X, phi


def _require_direction(direction: Array, n_vertices: int) -> Array:
    d = np.asarray(direction, dtype=np.float64)
    if d.shape not in ((3,), (n_vertices, 3)):
        raise ShapeError(
            f"A direction of shape {d.shape} for {n_vertices} vertices.",
            remedy="Give one vector, (3,), or one for each vertex.",
        )
    return d
