"""Every row of the oscillators' numerical extremes, the textbook formula beside it."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from project import ROOT

from modalmotion.errors import ParameterError
from modalmotion.modes import (
    Oscillators,
    State,
    exact_step,
    free_response,
    impulse_response,
    phase_error,
    ramp_response,
    step_response,
)
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CLOSED_CURVE, TORUS

_spec = importlib.util.spec_from_file_location(
    "extremes_oscillator_rows", ROOT / "tests" / "extremes" / "extremes_oscillator_rows.py"
)
assert _spec is not None
assert _spec.loader is not None
extremes = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(extremes)

Row = tuple[str, str, Callable[[], float], float]
ROWS: list[Row] = extremes.ROWS


@pytest.mark.every(3)
@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_row(row: Row) -> None:
    _, _, reached, bound = row
    assert reached() <= bound


def textbook(w: float, c: float, t: float) -> tuple[float, float]:
    """Impulse and step response from the two complex roots, as in any textbook."""
    with np.errstate(all="ignore"):
        root = np.sqrt(np.complex128(c**2 / 4 - w**2))
        r1, r2 = -c / 2 + root, -c / 2 - root
        impulse = (np.exp(r1 * t) - np.exp(r2 * t)) / (r1 - r2)
        kept = (r1 * np.exp(r2 * t) - r2 * np.exp(r1 * t)) / (r1 - r2)
        step = (1 - kept) / np.float64(w) ** 2
    return float(impulse.real), float(step.real)


def ours(w: float, c: float, t: float) -> tuple[float, float]:
    o, times = Oscillators(np.array([w]), c), np.array([t])
    return float(impulse_response(o, times)[0, 0]), float(step_response(o, times)[0, 0])


def errors_of(
    formula: Callable[[float, float, float], tuple[float, float]], w: float, c: float, t: float
) -> tuple[float, float]:
    right = extremes.exact(w, c, t)
    impulse, step = formula(w, c, t)
    return (
        abs(impulse / float(right["impulse"][0]) - 1),
        abs(step / float(right["step"][0]) - 1),
    )


def test_undamped_the_textbook_impulse_is_right_too() -> None:
    impulse, _ = errors_of(textbook, 1.0, 0.0, 1.0)
    assert impulse <= 1e-15
    assert max(errors_of(ours, 1.0, 0.0, 1.0)) <= 1e-15


def test_exactly_critical() -> None:
    assert np.isnan(textbook(1.0, 2.0, 1.0)).all()
    assert ours(1.0, 2.0, 1.0)[0] == pytest.approx(np.exp(-1.0), rel=1e-15, abs=0)


@pytest.mark.parametrize(("excess", "lost"), [(1e-8, 1e-13), (1e-15, 1e-11)])
def test_just_above_critical(excess: float, lost: float) -> None:
    times = np.linspace(0.3, 3.0, 10)
    naive = [errors_of(textbook, 1.0, 2 * (1 + excess), t)[0] for t in times]
    assert max(naive) >= lost
    assert max(max(errors_of(ours, 1.0, 2 * (1 + excess), t)) for t in times) <= 3e-15


def test_responses_are_continuous_through_critical() -> None:
    w, t = 1.7, np.array([0.01, 1.0, 5.0])
    c = 2 * w
    below = ramp_response(Oscillators(np.array([w]), np.nextafter(c, 0)), t)
    at = ramp_response(Oscillators(np.array([w]), c), t)
    above = ramp_response(Oscillators(np.array([w]), np.nextafter(c, 9)), t)
    assert below == pytest.approx(at, rel=5e-15, abs=0)
    assert above == pytest.approx(at, rel=5e-15, abs=0)


@pytest.mark.parametrize(("c", "impulse_lost", "step_lost"), [(1e8, 1e-9, 0.1), (1e12, 1e-13, 0.5)])
def test_overdamped(c: float, impulse_lost: float, step_lost: float) -> None:
    impulse, step = errors_of(textbook, 1.0, c, 1.0)
    assert impulse >= impulse_lost
    assert step >= step_lost
    assert max(errors_of(ours, 1.0, c, 1.0)) <= 1e-15


def test_step_response_at_c_1e12_is_1e_minus_12() -> None:
    assert ours(1.0, 1e12, 1.0)[1] == pytest.approx(1e-12, rel=2e-12, abs=0)


def test_rigid_mode() -> None:
    assert np.isnan(textbook(0.0, 0.0, 3.0)).all()
    o, t = Oscillators(np.zeros(1)), np.array([0.0, 3.0, 1e6, 1e-100])
    assert impulse_response(o, t)[:, 0].tolist() == t.tolist()
    assert step_response(o, t)[:, 0].tolist() == (t * t / 2).tolist()
    assert ramp_response(o, t)[:, 0] == pytest.approx(t**3 / 6, rel=1e-15, abs=0)


def test_almost_undamped_rigid_mode() -> None:
    impulse, step = textbook(0.0, 1e-9, 1.0)
    assert abs(impulse - 1.0) >= 1e-8
    assert not np.isfinite(step)
    assert ours(0.0, 1e-9, 1.0) == pytest.approx((1 - 5e-10, 0.5 - 1e-9 / 6), rel=1e-15, abs=0)


def test_tiny_frequency() -> None:
    assert abs(textbook(1e-15, 0.0, 1.0)[1] - 0.5) >= 0.4
    assert ours(1e-15, 0.0, 1.0) == (1.0, 0.5)


def test_strong_damping_and_long_times() -> None:
    c, t = 2e3, 1e3
    with np.errstate(all="ignore"):
        s = np.sqrt(c**2 / 4 - 1)
        hyperbolic = np.exp(-c / 2 * t) * np.sinh(s * t) / s
    assert np.isnan(hyperbolic)
    assert max(errors_of(ours, 1.0, c, t)) <= 1e-15


def test_stiff_lattice_where_explicit_schemes_blow_up() -> None:
    for lattice, limit in (
        (Lattice(CLOSED_CURVE, (16,), stiffness=9.0, mass=0.25), 1.0),
        (Lattice(TORUS, (16, 8), stiffness=9.0, mass=0.25), 1 / np.sqrt(2)),
    ):
        w = lattice.angular_frequencies(lattice.all_modes())
        assert 2 / w.max() == pytest.approx(limit * np.sqrt(0.25 / 9.0), rel=1e-12)
        h = 1.05 * 2 / w.max()
        oscillators = Oscillators(w)
        start = State(np.ones(len(w)), np.zeros(len(w)))

        u, v = start.amplitudes, start.velocities
        state, step = start, exact_step(oscillators, h)
        for _ in range(200):
            # Leapfrog: kick, drift, kick.
            v = v - 0.5 * h * w**2 * u
            u = u + h * v
            v = v - 0.5 * h * w**2 * u
            state = step.advance(state)
        assert np.abs(u).max() >= 1e20
        after = free_response(oscillators, np.array([200 * h]), start)
        assert np.abs(state.amplitudes).max() <= 1 + 1e-12
        bound = 1e-14 + phase_error(oscillators, np.array([200 * h]))[0]
        assert (np.abs(state.amplitudes - after.amplitudes[0]) <= bound).all()


def test_step_of_1e6_periods_undamped_reports_its_phase_error() -> None:
    o = Oscillators(np.array([0.0, 1.0, 2.0]))
    t = np.array([0.0, 2e6 * np.pi])
    expected = np.array([[0, 0, 0], [0, 1, 2]]) * 2e6 * np.pi * np.finfo(np.float64).eps
    assert phase_error(o, t) == pytest.approx(expected, rel=1e-15)
    # What rounding w by half a unit in its last place does to the phase stays below it.
    w = np.array([1.0 + 2.0**-40, np.nextafter(1.0 + 2.0**-40, 0)])
    swing = free_response(Oscillators(w), t[1:], State(np.zeros(2), w)).amplitudes[0]
    assert 0 < abs(swing[0] - swing[1]) <= 2 * phase_error(Oscillators(w), t[1:])[0, 0]


@pytest.mark.parametrize("bad", [-1.0, -1e-300, np.nan, np.inf])
def test_nonsense_is_refused_by_name(bad: float) -> None:
    with pytest.raises(ParameterError, match="angular frequency of mode 1") as caught:
        Oscillators(np.array([1.0, bad]))
    assert caught.value.details["mode"] == 1
    assert caught.value.remedy
    with pytest.raises(ParameterError, match="damping of mode 2"):
        Oscillators(np.ones(3), np.array([0.0, 1.0, bad]))
    for respond in (impulse_response, step_response, ramp_response, phase_error):
        with pytest.raises(ParameterError, match="Time 1") as caught:
            respond(Oscillators(np.ones(1)), np.array([0.0, bad]))
        assert caught.value.frame == 1
    with pytest.raises(ParameterError, match="leads nowhere"):
        exact_step(Oscillators(np.ones(1)), bad)


def test_responses_beyond_float64_are_refused_not_infinite() -> None:
    o = Oscillators(np.array([1.0, 0.0]))
    for respond in (step_response, ramp_response):
        with pytest.raises(ParameterError, match="mode 1 at time 1") as caught:
            respond(o, np.array([1.0, 1e200]))
        assert caught.value.frame == 1
    with pytest.raises(ParameterError, match=r"mode 1 after a step of length 1e\+200") as caught:
        exact_step(o, 1e200)
    assert caught.value.frame is None


@pytest.mark.every(5)
@pytest.mark.parametrize("w", [0.0, 1e-300, 1e-160, 1e-3, 1e160, 1e300])
@pytest.mark.parametrize("c", [0.0, 1e-300, 1e160, 1e308])
@pytest.mark.parametrize("t", [0.0, 1e-300, 1e-160, 1.0, 1e140])
def test_no_case_warns_or_gives_nan(w: float, c: float, t: float) -> None:
    o, times = Oscillators(np.array([w]), c), np.array([t])
    step = step_response(o, times)
    found: list[NDArray[np.float64]] = [impulse_response(o, times), step]
    moved = free_response(o, times, State(np.ones(1), np.zeros(1)))
    found += [moved.amplitudes, moved.velocities]
    assert np.isfinite(found).all()
    assert 0 <= step[0, 0] <= t * t
    assert abs(moved.amplitudes[0, 0]) <= 1
