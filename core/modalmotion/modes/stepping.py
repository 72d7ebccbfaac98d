"""The exact step: oscillators advanced over a time in which the force is linear."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import NonFiniteError, ParameterError, ShapeError
from modalmotion.modes import twofold
from modalmotion.modes.oscillators import Oscillators, State, per_mode, require_state
from modalmotion.modes.responses import responses
from modalmotion.modes.twofold import Twofold
from modalmotion.representation import shown

Array = NDArray[np.float64]


@shown("duration", "kept_whole")
@dataclass(frozen=True, eq=False)
class ExactStep:
    """Coefficients of one exact step, of any length: make it with `exact_step`.

    Each of the two diagonal coefficients is kept as a whole number, -1, 0 or 1, and a small
    rest: 1 - w^2 h^2 / 2 rounded to one float would leak energy at every step.

    Parameters
    ----------
    oscillators : Oscillators
    duration : float, time units
        h.
    kept_whole, kept_rest, kept_velocity_whole, kept_velocity_rest : (modes,) float64
    impulse, restoring : (modes,) float64
        g, and w^2 g.
    step, ramp : (modes,) float64
        Displacement under a force 1, and under one that rises from 0 to 1.
    """

    oscillators: Oscillators
    duration: float
    kept_whole: Array
    kept_rest: Array
    kept_velocity_whole: Array
    kept_velocity_rest: Array
    impulse: Array
    restoring: Array
    step: Array
    ramp: Array

    def advance(self, state: State) -> State:
        """State after the step without force.

        Parameters
        ----------
        state : State
            (modes, ...) each.

        Returns
        -------
        State

        Raises
        ------
        ShapeError
            If the state does not have one row for each mode.
        """
        return self._advance(require_state(self.oscillators, state), 0.0, 0.0)

    def advance_forced(self, state: State, force_start: Array, force_end: Array) -> State:
        """State after the step under a force that is linear over it.

        Parameters
        ----------
        state : State
            (modes, ...) each.
        force_start, force_end : (modes, ...) float64, mm per time unit squared
            Modal force per unit mass at both ends of the step; the same twice where it is
            constant.

        Returns
        -------
        State

        Raises
        ------
        ShapeError
            If the state or a force does not have the state's shape.
        """
        state = require_state(self.oscillators, state)
        u = state.amplitudes
        f0, f1 = (np.asarray(f, dtype=np.float64) for f in (force_start, force_end))
        if f0.shape != u.shape or f1.shape != u.shape:
            raise ShapeError(
                f"Forces of shape {f0.shape} and {f1.shape} on a state of shape {u.shape}.",
                remedy="Give one force for each mode and direction.",
            )
        g, S, T = (per_mode(values, u) for values in (self.impulse, self.step, self.ramp))
        rise = f1 - f0
        return self._advance(state, S * f0 + T * rise, g * f0 + (S / self.duration) * rise)

    def _advance(self, state: State, pushed: Array | float, speeded: Array | float) -> State:
        u, v = state.amplitudes, state.velocities
        A, a, B, b, g, w2_g = (
            per_mode(values, u)
            for values in (
                self.kept_whole,
                self.kept_rest,
                self.kept_velocity_whole,
                self.kept_velocity_rest,
                self.impulse,
                self.restoring,
            )
        )
        # u <- A u + (a u + g v + ...), A whole: the only error is the sum's rounding.
        du = (a * u + g * v) + (A * state.amplitude_rests + pushed)
        dv = (b * v - w2_g * u) + (B * state.velocity_rests + speeded)
        u_next, v_next = twofold.add(A * u, du), twofold.add(B * v, dv)
        return State(u_next.high, v_next.high, u_next.low, v_next.low)


def exact_step(oscillators: Oscillators, duration: float) -> ExactStep:
    """Exact step of length `duration`.

    Without damping a step changes the energy by 0.5 eps at most, 1.2 eps where it is a quarter
    of a period: the coefficients are adjusted within their last places until their determinant
    is 1.

    Parameters
    ----------
    oscillators : Oscillators
    duration : float, time units
        Length h of the step, of any size: every step is stable.

    Returns
    -------
    ExactStep

    Raises
    ------
    ParameterError
        If the duration is not positive and finite, or so long that a response exceeds the
        range of float64.
    """
    if not (math.isfinite(duration) and duration > 0):
        raise ParameterError(
            f"A step of length {duration} leads nowhere.",
            remedy="Use a finite length above zero.",
        )
    w, c = oscillators.angular_frequencies, oscillators.dampings
    r = responses(w, c, np.full_like(w, duration))
    if not np.isfinite(r.step).all():
        mode = int(np.flatnonzero(~np.isfinite(r.step))[0])
        raise ParameterError(
            f"After a step of length {duration} the response of mode {mode} exceeds the range "
            "of float64.",
            remedy="Use a shorter step, or a time unit in which it is a smaller number.",
            details={"mode": mode},
        )
    A, B = np.rint(r.kept), np.rint(r.kept_velocity)
    a = np.where(A == 1, -r.lost, r.kept - A)
    b = np.where(B == 1, -r.lost_velocity, r.kept_velocity - B)
    w2_g = w * (w * r.impulse)
    b, w2_g = _conserving(A, a, b, r.impulse, w2_g, undamped=c == 0)
    return ExactStep(oscillators, duration, A, a, B, b, r.impulse, w2_g, r.step, r.ramp)


def driven_states(
    step: ExactStep, forces: Iterable[NDArray[np.float64]], start: State
) -> Iterator[State]:
    """Motion under a series of forces, one state for each, in memory for two of them.

    Parameters
    ----------
    step : ExactStep
        From each force to the next.
    forces : iterable of (modes, ...) float64, mm per time unit squared
        Modal force per unit mass at each frame; linear in between.
    start : State
        At the first frame.

    Yields
    ------
    State
        At each frame, the first one included.

    Raises
    ------
    NonFiniteError
        Naming the frame whose force contains NaN or infinity.
    ShapeError
        If a force does not have the state's shape.
    """
    state = require_state(step.oscillators, start)
    before: NDArray[np.float64] | None = None
    for frame, force in enumerate(forces):
        now = np.asarray(force, dtype=np.float64)
        if not np.isfinite(now).all():
            raise NonFiniteError(
                f"The force at frame {frame} contains NaN or infinity, and every state after it "
                "would.",
                remedy="Leave such a force out, or set it to zero.",
                frame=frame,
            )
        if before is not None:
            state = step.advance_forced(state, before, now)
        before = now
        yield state


def _conserving(
    A: Array, a: Array, b: Array, g: Array, w2_g: Array, *, undamped: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Adjust b and w^2 g in their last places until (A + a)(A + b) + w^2 g^2 = 1.

    That determinant is the factor by which a step changes the energy. Without this the
    rounding of the coefficients, the same at every step, would change it by up to 1.8 eps.
    """
    # Each is adjusted where it is the less sensitive one; the second has finer last places.
    turned = undamped & (A == 0)
    excess = _determinant_excess(A, a, b, g, w2_g)
    w2_g = w2_g - np.where(turned, excess / np.where(turned, g, 1.0), 0.0)
    excess = _determinant_excess(A, a, b, g, w2_g)
    total = A + a
    sensitive = undamped & (np.abs(total) > 0.1)
    b = b - np.where(sensitive, excess / np.where(sensitive, total, 1.0), 0.0)
    return b, w2_g


def _determinant_excess(A: Array, a: Array, b: Array, g: Array, w2_g: Array) -> Array:
    """Evaluate (A + a)(A + b) + w^2 g^2 - 1 beyond the digits of a float; A = -1, 0 or 1."""
    # A^2 - 1 + A (a + b) + a b + g w^2 g: the large terms cancel.
    zero = np.zeros_like(a)
    total = twofold.add(a, b)
    products = (
        twofold.multiply(Twofold(a, zero), Twofold(b, zero)),
        twofold.multiply(Twofold(g, zero), Twofold(w2_g, zero)),
    )
    two = twofold.add(products[0].high, products[1].high)
    one = twofold.add(A * A - 1.0, A * total.high)
    three = twofold.add(one.high, two.high)
    rest = one.low + two.low + A * total.low + products[0].low + products[1].low
    return three.high + (three.low + rest)
