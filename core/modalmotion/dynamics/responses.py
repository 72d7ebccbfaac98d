"""Responses of oscillators over time, exact at every time by itself.

No response is built from the one before, so errors do not add up: with the frequencies
taken as exact, each is good to some 1e-15 of its envelope, at any time.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from modalmotion.dynamics.kernel import Responses, responses
from modalmotion.dynamics.oscillators import Oscillators, State, require_state, require_times
from modalmotion.errors import ParameterError

_MOST_VALUES_AT_ONCE = 65_536


def impulse_response(oscillators: Oscillators, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement after a unit velocity at time 0.

    Parameters
    ----------
    oscillators : Oscillators
    times : (times,) float64, time units
        From 0 on, in any order.

    Returns
    -------
    (times, modes) float64, time units

    Raises
    ------
    ParameterError
        If a time is negative or not finite.
    """
    return _at(oscillators, times).impulse


def step_response(oscillators: Oscillators, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement under a unit force that stays on from time 0.

    Parameters
    ----------
    oscillators : Oscillators
    times : (times,) float64, time units

    Returns
    -------
    (times, modes) float64, time units squared

    Raises
    ------
    ParameterError
        If a time is negative or not finite, or a response exceeds the range of float64.
    """
    return _require_range(_at(oscillators, times).step)


def ramp_response(oscillators: Oscillators, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement under a force that grows as the time.

    Parameters
    ----------
    oscillators : Oscillators
    times : (times,) float64, time units

    Returns
    -------
    (times, modes) float64, time units cubed

    Raises
    ------
    ParameterError
        If a time is negative or not finite, or a response exceeds the range of float64.
    """
    t = require_times(times)
    with np.errstate(over="ignore"):
        return _require_range(t[:, None] * _at(oscillators, t).ramp)


def free_response(oscillators: Oscillators, times: NDArray[np.float64], start: State) -> State:
    """Motion without force from an initial displacement and velocity.

    Parameters
    ----------
    oscillators : Oscillators
    times : (times,) float64, time units
    start : State
        At time 0, (modes, ...) each.

    Returns
    -------
    State
        (times, modes, ...) each.

    Raises
    ------
    ParameterError
        If a time is negative or not finite.
    ShapeError
        If the state does not have one row for each mode.
    """
    start = require_state(oscillators, start)
    u0, v0 = start.amplitudes, start.velocities
    r = _at(oscillators, times)
    w = oscillators.angular_frequencies
    parts = (r.kept, r.impulse, w * (w * r.impulse), r.kept_velocity)
    A, g, w2_g, B = (part.reshape(part.shape + (1,) * (u0.ndim - 1)) for part in parts)
    # u = A u0 + g v0 and u' = -w^2 g u0 + B v0
    return State(A * u0 + g * v0, B * v0 - w2_g * u0)


def free_states(
    oscillators: Oscillators, times: NDArray[np.float64], start: State
) -> Iterator[State]:
    """`free_response` one time after the other, in memory that does not grow with the times.

    Yields
    ------
    State
        (modes, ...) each.
    """
    t = require_times(times)
    start = require_state(oscillators, start)
    return _free_states(oscillators, t, start)


def _free_states(
    oscillators: Oscillators, times: NDArray[np.float64], start: State
) -> Iterator[State]:
    chunk = max(1, _MOST_VALUES_AT_ONCE // max(1, start.amplitudes.size))
    for first in range(0, len(times), chunk):
        several = free_response(oscillators, times[first : first + chunk], start)
        for u, v in zip(several.amplitudes, several.velocities, strict=True):
            yield State(u, v)


def _at(oscillators: Oscillators, times: NDArray[np.float64]) -> Responses:
    t = require_times(times)
    shape = (len(t), len(oscillators))
    return responses(
        np.broadcast_to(oscillators.angular_frequencies, shape),
        np.broadcast_to(oscillators.dampings, shape),
        np.broadcast_to(t[:, None], shape),
    )


def _require_range(values: NDArray[np.float64]) -> NDArray[np.float64]:
    beyond = np.argwhere(~np.isfinite(values))
    if beyond.size:
        frame, mode = (int(i) for i in beyond[0])
        raise ParameterError(
            f"The response of mode {mode} at time {frame} exceeds the range of float64.",
            remedy="Use shorter times, or a time unit in which they are smaller numbers.",
            frame=frame,
            details={"mode": mode},
        )
    return values
