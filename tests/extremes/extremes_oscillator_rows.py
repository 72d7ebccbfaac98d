"""Numerical extremes of the oscillators: what is right, and how near we come.

`ROWS` is read by the tests, which hold every row to its bound, and by the program that writes
the table of extremes. The reference is evaluated to as many digits as the case needs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import mpmath as mp
import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.modes import (
    Oscillators,
    State,
    energy,
    exact_step,
    free_response,
    impulse_response,
    ramp_response,
    step_response,
)
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CYLINDER

EPS: Final = float(np.finfo(np.float64).eps)
WITHIN_TEN: Final = 1e-14
# Below this the reference leaves the range of normal numbers.
UNDERFLOW: Final = 1e-290

Row = tuple[str, str, Callable[[], float], float]


def exact(w: float, c: float, t: float) -> dict[str, tuple[mp.mpf, mp.mpf]]:
    """Responses to as many digits as they need, each with its envelope.

    The inputs are taken as exact. `impulse` g, `step` S and `ramp` R are the displacements
    after a unit velocity, under a unit force, and under a force that grows as the time; `kept`
    A and `kept_velocity` B those after a unit displacement, and the velocity after a unit
    velocity.
    """
    with mp.workdps(max(_digits(w, c, t), 2 * mp.mp.dps)):
        W, C, T = mp.mpf(w), mp.mpf(c), mp.mpf(t)
        gamma, squared = C * T / 2, (C / 2) ** 2 - W**2
        x = mp.sqrt(abs(squared)) * T
        if squared == 0:
            cosine = sine = mp.mpf(1)
        elif squared > 0:
            cosine, sine = mp.cosh(x), mp.sinh(x) / x
        else:
            cosine, sine = mp.cos(x), mp.sin(x) / x
        E = mp.exp(-gamma)
        g, A, B = T * E * sine, E * (cosine + gamma * sine), E * (cosine - gamma * sine)
        if W > 0:
            S = (1 - A) / W**2
            R = (T - C * S - g) / W**2
        elif C > 0:
            S = (T - g) / C
            R = (T**2 / 2 - S) / C
        else:
            S, R = T**2 / 2, T**3 / 6
        if squared < 0:
            # Envelopes of an oscillation: what it reaches around this time.
            largest = E * min(mp.sqrt(1 + (gamma / x) ** 2), 1 + gamma)
            envelopes = (E * T * min(mp.mpf(1), 1 / x), largest, largest)
        else:
            fast = C / 2 + mp.sqrt(squared)
            slow = W**2 / fast if fast > 0 else mp.mpf(0)
            envelopes = (g, A, mp.exp(-fast * T) + slow * g)
        return {
            "impulse": (g, envelopes[0]),
            "step": (S, S),
            "ramp": (R, R),
            "kept": (A, envelopes[1]),
            "kept_velocity": (B, envelopes[2]),
        }


def computed(w: float, c: float, t: float) -> dict[str, float]:
    """The same responses as the library gives them."""
    o, times = Oscillators(np.array([w]), c), np.array([t])
    displaced = free_response(o, times, State(np.array([1.0]), np.array([0.0])))
    pushed = free_response(o, times, State(np.array([0.0]), np.array([1.0])))
    return {
        "impulse": float(impulse_response(o, times)[0, 0]),
        "step": float(step_response(o, times)[0, 0]),
        "ramp": float(ramp_response(o, times)[0, 0]),
        "kept": float(displaced.amplitudes[0, 0]),
        "kept_velocity": float(pushed.velocities[0, 0]),
    }


def error(w: float, c: float, t: float) -> float:
    """Largest error of all responses at one time, as part of their envelopes.

    Beyond w t = 10 it is divided by eps w t / 1e-14, so that 1e-14 is the bound everywhere.
    """
    found, worst = computed(w, c, t), 0.0
    for name, (value, envelope) in exact(w, c, t).items():
        if envelope > UNDERFLOW:
            worst = max(worst, float(abs(mp.mpf(found[name]) - value) / envelope))
    return worst if w * t <= 10 else worst * WITHIN_TEN / (EPS * w * t)


def worst_error(w: float, c: float, times: NDArray[np.float64]) -> float:
    """Largest `error` at several times."""
    return max(error(w, c, float(t)) for t in times)


def energy_drift(n_steps: int, turns: NDArray[np.float64]) -> float:
    """Largest change of an undamped oscillator's energy in a step, in units of eps.

    Parameters
    ----------
    n_steps : int
    turns : (oscillators,) float64, rad
        w h of each.
    """
    duration = 0.0625
    o = Oscillators(turns / duration)
    step, rng = exact_step(o, duration), np.random.default_rng(5)
    state = State(rng.uniform(-1, 1, len(o)), o.angular_frequencies * rng.uniform(-1, 1, len(o)))
    before = energy(o, state)
    for _ in range(n_steps):
        state = step.advance(state)
    return float(np.abs(energy(o, state) / before - 1).max() / (EPS * n_steps))


def energy_error(w: float, times: NDArray[np.float64]) -> float:
    """Largest relative error of the energy of an undamped free response."""
    o = Oscillators(np.array([w]))
    states = free_response(o, times, State(np.array([0.3]), np.array([0.4 * w])))
    now = 0.5 * (states.velocities**2 + (w * states.amplitudes) ** 2)
    return float(np.abs(now / (0.125 * w**2) - 1).max())


def stiff_lattice_error() -> float:
    """One step of a thousand times the explicit limit on a lattice, against the reference."""
    lattice = Lattice(CYLINDER, (6, 8), stiffness=(1e6, 4e6), mass=1e-3)
    w = np.unique(lattice.angular_frequencies(lattice.all_modes()))
    duration = 1000 * 2 / float(w.max())
    return max(error(float(each), 0.0, duration) for each in w)


def settling_error(ratios: tuple[float, ...]) -> float:
    """Distance from f / w^2, in units of eps, after a step of 1e6 periods."""
    worst = 0.0
    for w in (1e-3, 1.0, 7.3, 1e5):
        for ratio in ratios:
            o = Oscillators(np.array([w]), 2 * w * ratio)
            f = np.array([2.5])
            step = exact_step(o, 2e6 * math.pi / w)
            end = step.advance(State(np.array([1.0]), np.array([-3.0 * w])), f, f)
            at_rest = float(f[0]) / w**2
            away = abs(float(end.amplitudes[0]) / at_rest - 1) + abs(float(end.velocities[0]))
            worst = max(worst, away / EPS)
    return worst


def accepted_nonsense() -> float:
    """How many impossible oscillators, lattices and steps are not refused."""
    nan, inf = math.nan, math.inf
    attempts: list[Callable[[], object]] = [
        *(lambda w=w: Oscillators(np.array([1.0, w])) for w in (-1.0, -1e-300, nan, inf)),
        *(lambda c=c: Oscillators(np.array([1.0]), c) for c in (-1e-12, nan, inf)),
        *(lambda K=K: Lattice(CYLINDER, (3, 4), stiffness=K) for K in (0.0, -1.0, nan)),
        *(lambda M=M: Lattice(CYLINDER, (3, 4), mass=M) for M in (0.0, -1.0, inf)),
        *(lambda h=h: exact_step(Oscillators(np.array([1.0])), h) for h in (0.0, -1.0, nan)),
    ]
    accepted = 0
    for attempt in attempts:
        try:
            attempt()
        except ParameterError:
            continue
        accepted += 1
    return float(accepted)


def _digits(w: float, c: float, t: float) -> int:
    """Enough for every difference taken in `exact`."""
    digits = 60 + int(0.9 * min(c * t, 800.0))
    sizes = [math.log10(value) if value > 0 else 0.0 for value in (w, c, t)]
    if w > 0 and c != 2 * w:
        sizes.append(math.log10(abs(w - c / 2)) - sizes[0])
    digits += sum(2 * int(abs(size)) for size in (*sizes, sizes[0] + sizes[2], sizes[1] + sizes[2]))
    return digits


_SHORT = np.concatenate([np.logspace(-9, 1, 21), [0.9999, 1.0001, math.pi, 2 * math.pi]])
_LONG = np.array([30.0, 1e3, 1e5, 1e6 * 2 * math.pi])

ROWS: Final[list[Row]] = [
    (
        "undamped c = 0",
        "cos(w t), sin(w t) / w; within eps w t for 1e6 periods",
        lambda: max(worst_error(w, 0.0, np.concatenate([_SHORT, _LONG]) / w) for w in (1.0, 3e4)),
        WITHIN_TEN,
    ),
    (
        "undamped c = 0, energy over 1e6 periods",
        "constant",
        lambda: energy_error(3.7, np.linspace(0, 2e6 * math.pi / 3.7, 1001)),
        WITHIN_TEN,
    ),
    (
        "undamped c = 0, energy after 3000 steps of any length, in eps per step",
        "constant; at most 4",
        lambda: energy_drift(3000, np.concatenate([np.logspace(-5, 4, 300), _LONG])),
        4.0,
    ),
    (
        "exactly critical c = 2w",
        "impulse t e^(-wt)",
        lambda: max(worst_error(w, 2 * w, _SHORT / w) for w in (1.0, 0.3, 7e5)),
        WITHIN_TEN,
    ),
    *(
        (
            f"c = 2w(1{sign:+.0e})",
            "continuous through critical",
            lambda sign=sign: worst_error(
                1.3, 2.6 * (1 + sign), np.concatenate([_SHORT, [20.0, 100.0]]) / 1.3
            ),
            WITHIN_TEN,
        )
        for sign in (1e-8, 1e-15, -1e-8, -1e-15)
    ),
    (
        "overdamped c = 1e8, w = 1",
        "slow root -w^2 / (c/2 + s)",
        lambda: worst_error(1.0, 1e8, np.concatenate([np.logspace(-10, 1, 23), [1e6, 1e9]])),
        WITHIN_TEN,
    ),
    (
        "c = 1e12",
        "step response 1e-12 at t = 1",
        lambda: worst_error(1.0, 1e12, np.concatenate([np.logspace(-14, 1, 16), [1e12]])),
        WITHIN_TEN,
    ),
    (
        "w = 0, c = 0 (rigid mode)",
        "impulse t, step t^2 / 2, ramp t^3 / 6",
        lambda: worst_error(0.0, 0.0, np.logspace(-12, 12, 9)),
        WITHIN_TEN,
    ),
    (
        "w = 0, c = 1e-9",
        "impulse t (1 - c t / 2 + ...)",
        lambda: worst_error(0.0, 1e-9, np.logspace(-9, 12, 22)),
        WITHIN_TEN,
    ),
    (
        "w^2 = 1e-30",
        "step t^2 / 2",
        lambda: max(worst_error(1e-15, c, np.logspace(-6, 16, 23)) for c in (0.0, 1e-15, 1e-6)),
        WITHIN_TEN,
    ),
    (
        "c = 2e3 or larger, long t",
        "no overflow, no NaN: e^(-rt) (1 - e^(-2st)) / 2s",
        lambda: max(
            worst_error(1.0, c, np.array([0.1, 1.0, 10.0, 1e3, 1e5])) for c in (2e3, 1e5, 1e7)
        ),
        WITHIN_TEN,
    ),
    (
        "stiff lattice, one step 1000 times the explicit limit",
        "exact for each mode, at any step",
        stiff_lattice_error,
        WITHIN_TEN,
    ),
    (
        "step of 1e6 periods, damped, in eps",
        "at rest at f / w^2 but for the last places",
        lambda: settling_error((1e-4, 0.1, 1.0, 3.0)),
        4.0,
    ),
    (
        "step of 1e6 periods, undamped, phase error in eps w t",
        "at most 1: the phase error grows as eps w t",
        lambda: max(error(w, 0.0, 2e6 * math.pi / w) for w in (1.0, 0.7, 1e4)) / WITHIN_TEN,
        1.0,
    ),
    (
        "negative damping, negative or infinite frequency, K <= 0, M <= 0, h <= 0: accepted",
        "none of them",
        accepted_nonsense,
        0.0,
    ),
]
