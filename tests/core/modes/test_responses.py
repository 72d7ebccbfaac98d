"""Responses of oscillators: the laws they obey, then the reference to many digits."""

from __future__ import annotations

import importlib.util

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from project import ROOT
from scipy.integrate import solve_ivp

from modalmotion.errors import ShapeError
from modalmotion.modes import (
    Oscillators,
    State,
    energy,
    free_response,
    impulse_response,
    ramp_response,
    step_response,
)

_spec = importlib.util.spec_from_file_location(
    "extremes_oscillator_rows", ROOT / "tests" / "extremes" / "extremes_oscillator_rows.py"
)
assert _spec is not None
assert _spec.loader is not None
extremes = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(extremes)

W = np.array([0.0, 0.0, 0.5, 2.0, 2.0, 2.0, 1e-3])
C = np.array([0.0, 0.7, 0.0, 0.3, 4.0, 30.0, 1.0])
ALL = Oscillators(W, C)
TIMES = np.array([0.0, 0.01, 0.4, 1.0, 3.0, 11.0])

positive = st.floats(1e-3, 1e3)
damping = st.just(0.0) | st.floats(1e-9, 1e3)


def derivative(values: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Central difference of fourth order at the middle of five values."""
    rise: NDArray[np.float64] = values[0] - 8 * values[1] + 8 * values[3] - values[4]
    return rise / (12 * spacing)


def test_each_response_is_the_derivative_of_the_next() -> None:
    d = 1e-3
    for t in (0.5, 2.0, 7.0):
        around = t + d * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
        impulse, step = impulse_response(ALL, around), step_response(ALL, around)
        ramp = ramp_response(ALL, around)
        pushed = free_response(ALL, around, State(np.zeros(7), np.ones(7)))
        assert pushed.amplitudes == pytest.approx(impulse, rel=1e-13, abs=1e-16)
        assert derivative(ramp, d) == pytest.approx(step[2], rel=1e-8, abs=1e-10)
        assert derivative(step, d) == pytest.approx(impulse[2], rel=1e-8, abs=1e-10)
        assert derivative(impulse, d) == pytest.approx(pushed.velocities[2], rel=1e-8, abs=1e-8)


def test_responses_solve_their_equation() -> None:
    # u'' + c u' + w^2 u = f with f = 1, f = t: u' and u'' are the responses before.
    t = TIMES[:, None]
    g, S, R = (f(ALL, TIMES) for f in (impulse_response, step_response, ramp_response))
    B = free_response(ALL, TIMES, State(np.zeros(7), np.ones(7))).velocities
    assert B + C * g + W**2 * S == pytest.approx(np.ones_like(S), rel=1e-13)
    assert g + C * S + W**2 * R == pytest.approx(t + 0 * R, rel=1e-13)


def test_free_motion_agrees_with_a_numerical_integration() -> None:
    start = State(*np.random.default_rng(6).normal(size=(2, 7)))

    def rates(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([y[7:], -C * y[7:] - W**2 * y[:7]])

    slow = solve_ivp(
        rates,
        (0, 11.0),
        np.concatenate([start.amplitudes, start.velocities]),
        method="DOP853",
        t_eval=TIMES,
        rtol=1e-12,
        atol=1e-13,
    ).y.T
    fast = free_response(ALL, TIMES, start)
    assert fast.amplitudes == pytest.approx(slow[:, :7], rel=1e-9, abs=1e-10)
    assert fast.velocities == pytest.approx(slow[:, 7:], rel=1e-9, abs=1e-10)


def test_at_time_zero_nothing_has_happened() -> None:
    start = State(*np.random.default_rng(7).normal(size=(2, 7)))
    now = free_response(ALL, np.zeros(1), start)
    assert now.amplitudes.tolist() == [start.amplitudes.tolist()]
    assert now.velocities.tolist() == [start.velocities.tolist()]
    for respond in (impulse_response, step_response, ramp_response):
        assert not respond(ALL, np.zeros(1)).any()


@given(w=positive, c=damping, t1=positive, t2=positive)
def test_a_motion_goes_on_from_any_of_its_states(w: float, c: float, t1: float, t2: float) -> None:
    o = Oscillators(np.array([w]), c)
    start = State(np.array([0.3]), np.array([0.8 * w]))
    half = free_response(o, np.array([t1]), start)
    there = free_response(o, np.array([t2]), State(half.amplitudes[0], half.velocities[0]))
    whole = free_response(o, np.array([t1 + t2]), start)
    # t1 + t2 is rounded, which the motion sees as a phase and a decay.
    tolerance = 1e-14 + 4e-16 * (w + c) * (t1 + t2)
    assert abs(there.amplitudes - whole.amplitudes).max() <= tolerance
    assert abs(there.velocities - whole.velocities).max() <= tolerance * w * (1 + c / w)


@given(w=positive, c=st.floats(1e-9, 1e3), t=positive)
def test_damping_never_feeds_energy(w: float, c: float, t: float) -> None:
    o = Oscillators(np.array([w]), c)
    start = State(np.array([1.0]), np.array([-0.5 * w]))
    later = free_response(o, np.array([t]), start)
    now = State(later.amplitudes[0], later.velocities[0])
    assert energy(o, now)[0] <= energy(o, start)[0] * (1 + 1e-14)


@given(w=positive, c=damping, t=positive, factor=st.integers(-30, 30))
def test_units_of_time_do_not_matter(w: float, c: float, t: float, factor: int) -> None:
    # A power of two changes no bit of any digit.
    unit = 2.0**factor
    o, other = Oscillators(np.array([w]), c), Oscillators(np.array([w / unit]), c / unit)
    for power, respond in enumerate((impulse_response, step_response, ramp_response), start=1):
        here, there = respond(o, np.array([t])), respond(other, np.array([t * unit]))
        if here[0, 0] > extremes.UNDERFLOW:
            assert there[0, 0] == here[0, 0] * unit**power


def test_step_response_is_never_negative_and_settles() -> None:
    times = np.linspace(0, 60, 4001)
    o = Oscillators(np.array([2.0, 2.0, 2.0]), np.array([0.0, 0.5, 5.0]))
    response = step_response(o, times)
    assert response.min() >= 0
    assert response.max() <= 2 / 4.0 * (1 + 1e-15)
    assert response[-1, 1:] == pytest.approx([0.25, 0.25], rel=1e-6)


def cases(seed: int, n: int) -> list[tuple[float, float, float]]:
    """Frequencies, dampings and times on logarithmic scales, every regime among them."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(n):
        t = 10 ** rng.uniform(-6, 6)
        w = 10 ** rng.uniform(-2, 2) / t
        k = int(rng.integers(1, 17))
        found += [
            (10 ** rng.uniform(-8, 8), 10 ** rng.uniform(-9, 12), t),
            (w, 10 ** rng.uniform(-3, 3) / t, t),
            (w, 2 * w * (1 + float(rng.choice([-1, 1])) * 10.0**-k), t),
            (10 ** rng.uniform(-1, 8) / t, 10 ** rng.uniform(-12, 0) / t, t),
            (10 ** rng.uniform(-30, 0) / t, 10 ** rng.uniform(-4, 3) / t, t),
            (0.0, 10 ** rng.uniform(-20, 3) / t, t),
        ]
    return found


def test_every_regime_to_1e_minus_14_of_its_envelope() -> None:
    for w, c, t in cases(3, 40):
        # Beyond w t = 10 the measure is eps w t, and a quarter of it is enough.
        assert extremes.error(w, c, t) <= (5e-15 if w * t <= 10 else 2.5e-15), (w, c, t)


def test_slow_decay_loses_nothing_over_long_times() -> None:
    # e^(-r t) with r t in the hundreds: r needs more than one float.
    for w, c, t in ((0.7, 2.1, 900.0), (3.3, 7.0, 150.0), (1.0, 30.0, 9000.0)):
        assert extremes.error(w, c, t) * w * t * 2.2e-16 / 1e-14 <= 4e-15


def test_far_beyond_what_w_t_and_c_t_can_hold() -> None:
    for w, c, t in ((1.0, 1e160, 1e160), (1e100, 2e100, 1e250), (1e100, 1e250, 1e150)):
        found = extremes.computed(w, c, t)
        for name, (value, envelope) in extremes.exact(w, c, t).items():
            if envelope > extremes.UNDERFLOW:
                assert abs(found[name] / value - 1) <= 1e-14


@pytest.mark.soak
def test_every_regime_at_length() -> None:
    worst = max(cases(4, 3000), key=lambda case: extremes.error(*case))
    assert extremes.error(*worst) <= 1e-14, worst


def test_the_reference_solves_the_equation() -> None:
    # The oracle itself, differentiated to 25 digits and more.
    for w, c in ((1.3, 0.4), (1.3, 2.6), (1.3, 9.0), (0.0, 0.5)):

        def ramp(t: mp.mpf, w: float = w, c: float = c) -> mp.mpf:
            return extremes.exact(w, c, t)["ramp"][0]

        with mp.workdps(50):
            t = mp.mpf("1.7")
            u, v, a = (mp.diff(ramp, t, order) for order in range(3))
            assert abs(a + c * v + mp.mpf(w) ** 2 * u - t) <= mp.mpf(10) ** -25


def test_shapes_follow_modes_and_directions() -> None:
    rng = np.random.default_rng(0)
    start = State(rng.normal(size=(7, 3)), rng.normal(size=(7, 3)))
    all_at_once = free_response(ALL, TIMES, start)
    assert all_at_once.amplitudes.shape == (6, 7, 3)
    for direction in range(3):
        one = State(start.amplitudes[:, direction], start.velocities[:, direction])
        alone = free_response(ALL, TIMES, one)
        assert np.array_equal(alone.amplitudes, all_at_once.amplitudes[:, :, direction])
        assert np.array_equal(alone.velocities, all_at_once.velocities[:, :, direction])


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ShapeError):
        Oscillators(np.ones((2, 2)))
    with pytest.raises(ShapeError):
        Oscillators(np.ones(2), np.ones(3))
    with pytest.raises(ShapeError):
        free_response(ALL, TIMES, State(np.ones(6), np.ones(6)))
    with pytest.raises(ShapeError):
        free_response(ALL, TIMES, State(np.ones(7), np.ones((7, 3))))
    with pytest.raises(ShapeError):
        impulse_response(ALL, np.ones((2, 2)))


def test_oscillators_do_not_follow_their_callers_arrays() -> None:
    w = np.ones(2)
    o = Oscillators(w)
    w[0] = 5.0
    assert o.angular_frequencies.tolist() == [1.0, 1.0]
    assert np.asarray(o.damping).tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="read-only"):
        o.angular_frequencies[0] = 5.0
