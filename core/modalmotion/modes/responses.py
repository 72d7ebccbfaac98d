"""Responses of u'' + c u' + w^2 u = f over one step, in one stable form for every regime.

With r <= R the two decay rates, the roots of R^2 - c R + w^2 = 0 (a conjugate pair where
c < 2w), z = r h and Z = R h, every response is a divided difference of the exponential:

    impulse   g = h   exp[-z, -Z]
    step      S = h^2 exp[-z, -Z, 0]
    ramp      T = h^2 exp[-z, -Z, 0, 0]     to a force that rises from 0 to 1 over the step

which has no singular point: not at c = 2w, where the roots meet, nor at w = 0 or c = 0.
They are evaluated by recursion where the roots are apart from 0, and as a power series where
they do not; neither subtracts nearly equal numbers.

Source of the divided differences: McCurdy, Ng and Parlett, "Accurate computation of divided
differences of the exponential function", Mathematics of Computation 43, 1984.

Angles are unevaluated sums of two floats: a phase w t of 1e6 rad rounded to one float is wrong by
1e-10 rad before its cosine is taken. Source: Dekker, "A floating-point technique for extending the
available precision", Numerische Mathematik 18, 1971. Relative error about 1e-31 while no product
underflows; where one does, or overflows, the value falls back to one float.
"""

from typing import Final, NamedTuple

import numpy as np

from modalmotion.representation import Bools, Floats, shown

_SPLITTER: Final = 2.0**27 + 1.0
_LARGEST: Final = 1e300


class Twofold(NamedTuple):
    """The sum high + low, low below half a unit in the last place of high."""

    high: Floats
    low: Floats


def add(a: Floats, b: Floats) -> Twofold:
    """Sum a + b without error."""
    high = a + b
    b_seen = high - a
    return Twofold(high, (a - (high - b_seen)) + (b - b_seen))


def multiply(x: Twofold, y: Twofold) -> Twofold:
    """Product of two twofold numbers."""
    high, low = _product(x.high, y.high)
    return _renormalise(high, low + (x.high * y.low + x.low * y.high))


def scale(x: Twofold, factor: Floats) -> Twofold:
    """Product of a twofold number and a float."""
    high, low = _product(x.high, factor)
    return _renormalise(high, low + x.low * factor)


def divide(a: Floats, y: Twofold) -> Twofold:
    """Quotient a / y, and 0 where y is 0."""
    is_zero = y.high == 0
    divisor = np.where(is_zero, 1.0, y.high)
    quotient = np.where(is_zero, 0.0, a / divisor)
    high, low = _product(quotient, divisor)
    rest = ((a - high) - low) - quotient * y.low
    return _renormalise(quotient, np.where(is_zero, 0.0, rest / divisor))


def sqrt(x: Twofold) -> Twofold:
    """Square root of a twofold number that is not negative."""
    root = np.sqrt(x.high)
    high, low = _product(root, root)
    rest = ((x.high - high) - low) + x.low
    return _renormalise(root, rest / np.where(root == 0, 1.0, 2.0 * root))


def bounded(x: Twofold) -> Twofold:
    """Limit a number to +-1e300, so that no function of it meets an infinity."""
    beyond = ~(np.abs(x.high) <= _LARGEST)
    return Twofold(np.where(beyond, np.copysign(_LARGEST, x.high), x.high), x.low * ~beyond)


def _product(a: Floats, b: Floats) -> tuple[Floats, ...]:
    product = a * b
    a_high, a_low = _split(a)
    b_high, b_low = _split(b)
    error = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
    return product, error


def _split(a: Floats) -> tuple[Floats, ...]:
    t = _SPLITTER * a
    high = t - (t - a)
    return high, a - high


def _renormalise(high: Floats, low: Floats) -> Twofold:
    low = np.where(np.isfinite(low), low, 0.0)
    total = high + low
    return Twofold(total, np.where(np.isfinite(total), low - (total - high), 0.0))


# The series runs while the larger root is below this, and then to this many terms.
_SERIES_BELOW: Final = 1.0
_N_TERMS: Final = 20


@shown("impulse", "step", "ramp")
class Responses(NamedTuple):
    """Responses after a time h, all of one shape.

    Parameters
    ----------
    impulse : time units
        g, displacement after a unit velocity.
    step : time units squared
        S, displacement under a unit force that stays on.
    ramp : time units squared
        T, displacement under a force that rises linearly from 0 to 1 over h.
    kept : 1
        A = 1 - w^2 S, displacement after a unit displacement.
    lost : 1
        1 - A, to full precision where it is small.
    kept_velocity : 1
        B = g', velocity after a unit velocity.
    lost_velocity : 1
        1 - B, to full precision where it is small.
    """

    impulse: Floats
    step: Floats
    ramp: Floats
    kept: Floats
    lost: Floats
    kept_velocity: Floats
    lost_velocity: Floats


class _Rates(NamedTuple):
    h: Floats
    w: Floats
    half: Floats  # c / 2
    s: Floats  # half the distance of the roots
    slow: Floats  # r
    fast: Floats  # R
    gamma: Twofold  # c h / 2
    x: Twofold  # s h
    slow_z: Twofold  # z = r h
    fast_z: Twofold  # Z = R h


def responses(w: Floats, c: Floats, h: Floats) -> Responses:
    """Responses of oscillators after a time.

    Parameters
    ----------
    w, c, h : (...) float64
        Angular frequencies, dampings and times: finite, not negative, of one shape.
    """
    shape = np.shape(h)
    w, c, h = (np.ascontiguousarray(a, dtype=np.float64).ravel() for a in (w, c, h))
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        rates = _rates(w, c, h)
        oscillates = rates.half < w
        small = np.where(oscillates, w * h, rates.fast_z.high) < _SERIES_BELOW
        out = np.empty((len(Responses._fields), h.size))
        for where, rule in (
            (small, _near_zero),
            (~small & oscillates, _oscillating),
            (~small & ~oscillates, _decaying),
        ):
            if where.any():
                out[:, where] = rule(_at(rates, where))
    return Responses(*(row.reshape(shape) for row in out))


def _rates(w: Floats, c: Floats, h: Floats) -> _Rates:
    half = 0.5 * c
    # s^2 = (c/2 - w)(c/2 + w): the difference is exact, however near the critical damping.
    total = add(half, w)
    difference = add(np.maximum(half, w), -np.minimum(half, w))
    s = multiply(sqrt(difference), sqrt(total))
    # R = c/2 + s and r = w^2 / R: c/2 - s would lose every digit at c = 1e8 w.
    is_real = half >= w
    fast = add(half, np.where(is_real, s.high, 0.0))
    fast = Twofold(fast.high, fast.low + np.where(is_real, s.low, 0.0))
    slow = scale(divide(w, fast), w)
    angles = (Twofold(half, np.zeros_like(half)), s, slow, fast)
    gamma, x, slow_z, fast_z = (bounded(scale(rate, h)) for rate in angles)
    return _Rates(h, w, half, s.high, slow.high, fast.high, gamma, x, slow_z, fast_z)


def _at(q: _Rates, where: Bools) -> _Rates:
    floats = (a[where] for a in (q.h, q.w, q.half, q.s, q.slow, q.fast))
    h, w, half, s, slow, fast = floats
    twofolds = (Twofold(a.high[where], a.low[where]) for a in (q.gamma, q.x, q.slow_z, q.fast_z))
    gamma, x, slow_z, fast_z = twofolds
    return _Rates(h, w, half, s, slow, fast, gamma, x, slow_z, fast_z)


def _near_zero(q: _Rates) -> tuple[Floats, ...]:
    """Both roots near 0, or at it: a power series in them."""
    gamma, omega = q.gamma.high, q.w * q.h
    # exp[-z, -Z, 0] = sum (-1)^n h_n(z, Z) / (n + 2)!, one factorial on for each further 0,
    # h_n = 2 gamma h_(n-1) - omega^2 h_(n-2) the complete symmetric polynomials of the roots.
    before, now = np.zeros_like(omega), np.ones_like(omega)
    step, ramp = 0.5 * now, now / 6.0
    factorial = 2.0
    for n in range(1, _N_TERMS):
        before, now = now, 2.0 * gamma * now - omega**2 * before
        factorial *= -(n + 2)
        step = step + now / factorial
        ramp = ramp + now / (factorial * (n + 3))
    G = np.where(q.half < q.w, _exp(q.gamma) * _sinc(q.x), _exp(q.slow_z) * _mean_decay(q.x))
    lost = omega**2 * step
    lost_velocity = lost + 2.0 * gamma * G
    return (
        q.h * G,
        q.h * (q.h * step),
        q.h * (q.h * ramp),
        1.0 - lost,
        lost,
        1.0 - lost_velocity,
        lost_velocity,
    )


def _oscillating(q: _Rates) -> tuple[Floats, ...]:
    """Complex roots, away from 0."""
    E = _exp(q.gamma)
    cosine, g = E * _cos(q.x), E * _sin(q.x) / q.s
    half_g = q.half * g
    # 1 - A = e^-gamma (1 - cos x) + [1 - e^-gamma - (c/2) g], neither of them negative;
    # 1 - B is the same with the last sign turned.
    half_sine = _sin(Twofold(0.5 * q.x.high, 0.5 * q.x.low))
    turned, decayed = 2.0 * E * half_sine**2, -np.expm1(-q.gamma.high)
    lost = turned + (decayed - half_g)
    # w^2 T = 1 - (g + c S) / h
    ramp = 1.0 - g / q.h - 2.0 * (q.half / q.w) * (lost / (q.w * q.h))
    return (
        g,
        lost / q.w / q.w,
        ramp / q.w / q.w,
        cosine + half_g,
        lost,
        cosine - half_g,
        turned + (decayed + half_g),
    )


def _decaying(q: _Rates) -> tuple[Floats, ...]:
    """Real roots, the larger one away from 0."""
    # g = e^-z (1 - e^-2x) / 2s, 2s = R - r; the roots may meet, or be too far for h.
    near = q.x.high < 1.0
    g = _exp(q.slow_z) * np.where(
        near, q.h * _mean_decay(q.x), -np.expm1(-2.0 * q.x.high) / np.where(near, 1.0, 2.0 * q.s)
    )
    # h exp[-z, 0] = (1 - e^-z) / r and h exp[-z, 0, 0] = (1 - exp[-z, 0]) / r
    phi_1, phi_2 = _phi(q)
    step = (phi_1 - g) / q.fast
    kept_velocity = _exp(q.fast_z) - q.slow * g
    return (
        g,
        step,
        phi_2 / q.fast - step / q.fast_z.high,
        _exp(q.slow_z) + q.slow * g,
        q.slow * (phi_1 - g),
        kept_velocity,
        1.0 - kept_velocity,
    )


def _exp(x: Twofold) -> Floats:
    """e^-x."""
    return np.exp(-x.high) * (1.0 - x.low)


def _mean_decay(x: Twofold) -> Floats:
    """(1 - e^-2x) / 2x, and 1 at 0."""
    numerator = -np.expm1(-2.0 * x.high) + 2.0 * x.low * np.exp(-2.0 * x.high)
    is_zero = x.high == 0
    return np.where(is_zero, 1.0, numerator / np.where(is_zero, 1.0, 2.0 * x.high))


def _sin(x: Twofold) -> Floats:
    return np.asarray(np.sin(x.high) * np.cos(x.low) + np.cos(x.high) * np.sin(x.low))


def _cos(x: Twofold) -> Floats:
    return np.asarray(np.cos(x.high) * np.cos(x.low) - np.sin(x.high) * np.sin(x.low))


def _sinc(x: Twofold) -> Floats:
    """sin(x) / x, and 1 at 0."""
    is_zero = x.high == 0
    return np.where(is_zero, 1.0, _sin(x) / np.where(is_zero, 1.0, x.high))


def _phi(q: _Rates) -> tuple[Floats, Floats]:
    """(1 - e^-z) / r and its successor, with their limits h and h / 2 at r = 0."""
    z = q.slow_z.high
    is_small = z < 1.0
    r = np.where(is_small, 1.0, q.slow)
    phi_1 = -np.expm1(-z) / r
    phi_2 = (1.0 - phi_1 / q.h) / r
    # exp[-z, 0, 0] = sum (-z)^n / (n + 2)!, and exp[-z, 0] = 1 - z exp[-z, 0, 0].
    y = np.where(is_small, z, 0.0)
    term, series = np.full_like(y, 0.5), np.full_like(y, 0.5)
    for n in range(3, _N_TERMS):
        term = -term * y / n
        series = series + term
    return np.where(is_small, q.h * (1.0 - y * series), phi_1), np.where(
        is_small, q.h * series, phi_2
    )
