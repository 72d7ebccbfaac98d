"""Damped oscillators, one for each mode: their equation, their state, their energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown


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
