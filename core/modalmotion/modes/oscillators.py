"""Damped oscillators, one per mode: equation (3), their motion, and the exact step.

As figures 2 and 3 of Nastar (1994). The modes may be of anything: shapes at the nodes of a
lattice or at the vertices of a mesh serve alike.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from modalmotion.arguments.checking import FrozenArrays
from modalmotion.errors import NonFiniteError, ParameterError, ShapeError
from modalmotion.modes.responses import Responses, Twofold, add, multiply, responses
from modalmotion.representation import Bools, Floats, shown


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

    amplitudes: Floats
    velocities: Floats
    amplitude_rests: Floats | float = 0.0
    velocity_rests: Floats | float = 0.0


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

    angular_frequencies: Floats
    damping: Floats | float = 0.0

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


def energy(oscillators: Oscillators, state: State) -> Floats:
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
    w = _per_mode(oscillators.angular_frequencies, state.amplitudes)
    return 0.5 * (state.velocities**2 + (w * state.amplitudes) ** 2)


def phase_error(oscillators: Oscillators, times: Floats) -> Floats:
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


def require_times(times: Floats) -> Floats:
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
        raise ShapeError(f"Times have the shape {t.shape}.", remedy="Give one row of times.")
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


def _per_mode(values: Floats, like: Floats) -> Floats:
    """One value for each mode, shaped to multiply (modes, ...)."""
    return values.reshape(values.shape + (1,) * (like.ndim - 1))


def impulse_response(oscillators: Oscillators, times: Floats) -> Floats:
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
    return _free_at(oscillators, times).impulse


def step_response(oscillators: Oscillators, times: Floats) -> Floats:
    """Displacement under a unit force that stays on from time 0.

    Returns
    -------
    (times, modes) float64, time units squared

    Raises
    ------
    ParameterError
        If a time is negative or not finite, or a response exceeds the range of float64.
    """
    return _require_range(_free_at(oscillators, times).step)


def ramp_response(oscillators: Oscillators, times: Floats) -> Floats:
    """Displacement under a force that grows as the time.

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
        return _require_range(t[:, None] * _free_at(oscillators, t).ramp)


def free_response(oscillators: Oscillators, times: Floats, start: State) -> State:
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
    r = _free_at(oscillators, times)
    w = oscillators.angular_frequencies
    parts = (r.kept, r.impulse, w * (w * r.impulse), r.kept_velocity)
    A, g, w2_g, B = (part.reshape(part.shape + (1,) * (u0.ndim - 1)) for part in parts)
    # u = A u0 + g v0 and u' = -w^2 g u0 + B v0
    return State(A * u0 + g * v0, B * v0 - w2_g * u0)


def _free_at(oscillators: Oscillators, times: Floats) -> Responses:
    t = require_times(times)
    shape = (len(t), len(oscillators))
    return responses(
        np.broadcast_to(oscillators.angular_frequencies, shape),
        np.broadcast_to(np.asarray(oscillators.damping), shape),
        np.broadcast_to(t[:, None], shape),
    )


def _require_range(values: Floats, step: str = "") -> Floats:
    """Refuse responses beyond float64, (times, modes); or (1, modes) after the one `step`."""
    beyond = np.argwhere(~np.isfinite(values))
    if beyond.size:
        frame, mode = (int(i) for i in beyond[0])
        raise ParameterError(
            f"The response of mode {mode} {step or f'at time {frame}'} exceeds the range of "
            "float64.",
            remedy="Use shorter times, or a time unit in which they are smaller numbers.",
            frame=None if step else frame,
            details={"mode": mode},
        )
    return values


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
    kept_whole: Floats
    kept_rest: Floats
    kept_velocity_whole: Floats
    kept_velocity_rest: Floats
    impulse: Floats
    restoring: Floats
    step: Floats
    ramp: Floats

    def advance(
        self, state: State, force_start: Floats | float = 0.0, force_end: Floats | float = 0.0
    ) -> State:
        """State after the step, under a force that is linear over it.

        Parameters
        ----------
        state : State
            (modes, ...) each.
        force_start, force_end : (modes, ...) float64, or 0, mm per time unit squared
            Modal force per unit mass at both ends of the step; the same twice where it is
            constant.

        Raises
        ------
        ShapeError
            If the state does not have one row for each mode, or a force not the state's shape.
        """
        state = require_state(self.oscillators, state)
        u, v = state.amplitudes, state.velocities
        f0, f1 = (np.asarray(f, dtype=np.float64) for f in (force_start, force_end))
        if not {f0.shape, f1.shape} <= {(), u.shape}:
            raise ShapeError(
                f"Forces of shape {f0.shape} and {f1.shape} on a state of shape {u.shape}.",
                remedy="Give one force for each mode and direction.",
            )
        A, a, B, b, g, w2_g, S, T = (
            _per_mode(values, u)
            for values in (
                *(self.kept_whole, self.kept_rest),
                *(self.kept_velocity_whole, self.kept_velocity_rest),
                *(self.impulse, self.restoring, self.step, self.ramp),
            )
        )
        rise = f1 - f0
        pushed, speeded = S * f0 + T * rise, g * f0 + (S / self.duration) * rise
        # u <- A u + (a u + g v + ...), A whole: the only error is the sum's rounding.
        du = (a * u + g * v) + (A * state.amplitude_rests + pushed)
        dv = (b * v - w2_g * u) + (B * state.velocity_rests + speeded)
        u_next, v_next = add(A * u, du), add(B * v, dv)
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
    w, c = oscillators.angular_frequencies, np.asarray(oscillators.damping)
    r = responses(w, c, np.full_like(w, duration))
    _require_range(r.step[None], f"after a step of length {duration}")
    A, B = np.rint(r.kept), np.rint(r.kept_velocity)
    a = np.where(A == 1, -r.lost, r.kept - A)
    b = np.where(B == 1, -r.lost_velocity, r.kept_velocity - B)
    w2_g = w * (w * r.impulse)
    b, w2_g = _conserving(A, a, b, r.impulse, w2_g, undamped=c == 0)
    return ExactStep(oscillators, duration, A, a, B, b, r.impulse, w2_g, r.step, r.ramp)


def driven_states(step: ExactStep, forces: Iterable[Floats], start: State) -> Iterator[State]:
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
    before: Floats | None = None
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
            state = step.advance(state, before, now)
        before = now
        yield state


def _conserving(
    A: Floats, a: Floats, b: Floats, g: Floats, w2_g: Floats, *, undamped: Bools
) -> tuple[Floats, Floats]:
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


def _determinant_excess(A: Floats, a: Floats, b: Floats, g: Floats, w2_g: Floats) -> Floats:
    """Evaluate (A + a)(A + b) + w^2 g^2 - 1 beyond the digits of a float; A = -1, 0 or 1."""
    # A^2 - 1 + A (a + b) + a b + g w^2 g: the large terms cancel.
    zero = np.zeros_like(a)
    total = add(a, b)
    products = (
        multiply(Twofold(a, zero), Twofold(b, zero)),
        multiply(Twofold(g, zero), Twofold(w2_g, zero)),
    )
    two = add(products[0].high, products[1].high)
    one = add(A * A - 1.0, A * total.high)
    three = add(one.high, two.high)
    rest = one.low + two.low + A * total.low + products[0].low + products[1].low
    return three.high + (three.low + rest)
